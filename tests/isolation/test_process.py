"""The isolated process: what it can access, errors without isolation, and each layer separately."""

import errno
import json
import os
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Sequence
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.runtime.isolation import mounts, sandbox, syscall_filter
from actors.runtime.isolation.sandbox import (
    ISOLATION_RISKS,
    IsolationChoice,
    advice,
    choose_isolation,
    container_kind,
    print_warning,
    remedy,
)
from actors.runtime.isolation.syscall_filter import Instruction
from tests.isolation.test_attacks import need_isolation
from tests.refusals import refused

PRELUDE = """
import os, sys
from pathlib import Path
from actors.runtime.isolation import sandbox, syscall_filter
from actors.runtime import linux
from actors.runtime.isolation.mounts import file_view
from actors.runtime.isolation.sandbox import SandboxSetup, isolation_fault
from actors.runtime.linux import die_with_parent

def isolate(own, *view):
    sandbox.isolate(lambda: SandboxSetup(file_view(own, *view)))
    os.chdir(own)

def attempt(act):
    try:
        return act()
    except OSError as error:
        return type(error).__name__
"""


def run(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", PRELUDE + textwrap.dedent(code), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def said(code: str, *arguments: object) -> list[str]:
    done = run(code, *arguments)
    assert done.returncode == 0, done.stderr
    lines: list[str] = done.stdout.splitlines()
    return lines


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    need_isolation()
    for robot in ("r1", "r2"):
        (tmp_path / "out" / robot).mkdir(parents=True)
        (tmp_path / "out" / robot / "credentials").write_text(f"{robot}:secret\n")
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "corridor.png").write_text("walls")
    return tmp_path / "out"


def test_a_sandboxed_process_keeps_its_folder_named_files_and_libraries(run_folder: Path) -> None:
    own, chart = run_folder / "r1", run_folder.parent / "maps" / "corridor.png"
    lines = said(
        """
        own, chart = Path(sys.argv[1]), Path(sys.argv[2])
        folder = os.open(own.parent, os.O_RDONLY)
        isolate(own, (own.parent,), (chart,))
        nothing = os.stat(os.devnull).st_rdev
        print(os.fstat(folder).st_rdev == nothing, os.fstat(0).st_rdev == nothing)
        print(Path.cwd() == own, sorted(path.name for path in own.parent.iterdir()))
        print((own / "recording.mcap").write_text("kept"))
        for path in (Path("/dev/lost"), Path("/etc/lost"), Path("/lost"), chart):
            print(attempt(lambda: path.write_text("")))
        print((Path("/tmp") / "scratch").write_text("gone"))
        print(chart.read_text(), sorted(path.name for path in chart.parent.iterdir()))
        import subprocess, threading
        import numpy, zenoh
        print(numpy.ones((300, 300)).dot(numpy.ones((300, 300)))[0, 0])
        child = subprocess.run([sys.executable, "-c", "print(1)"], capture_output=True, text=True)
        print(os.cpu_count() > 0, child.stdout.strip(), len(os.urandom(4)), os.listdir("/sys"))
        thread = threading.Thread(target=print, args=("thread",)); thread.start(); thread.join()
        """,
        own,
        chart,
    )
    assert lines == [
        *("True True", "True ['r1']", "4", *["OSError"] * 4, "4", "walls ['corridor.png']"),
        *("300.0", "True 1 4 ['devices']", "thread"),
    ]
    assert (own / "recording.mcap").read_text() == "kept"
    assert not Path("/tmp/scratch").exists()


def test_a_view_after_a_survey_is_that_of_a_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = ("study/scenario.toml", "study/other.toml", "study/part/own.py")
    runs = ("tried/a.txt", "tried/r/r1/setup.json")
    for file in ("tool.py", "notes/a.txt", "notes/old.toml", *study, *runs):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    monkeypatch.setattr(mounts, "_PROJECT", tmp_path)
    monkeypatch.setattr(mounts, "_ROBOT_FOLDERS", tuple(tmp_path / one for one in ("notes", "tried", "gone")))
    monkeypatch.setattr(mounts, "_runless", set())
    hidden = ((), (tmp_path / "tool.py", tmp_path / study[0]), (tmp_path / "notes/a.txt",))

    def entries() -> list[list[str]]:
        found = [mounts.code_entries(tmp_path, mounts.hidden_paths(some)) for some in hidden]
        return [[str(path.relative_to(tmp_path)) for path in paths] for paths in found]

    searched = entries()
    mounts.survey()
    assert mounts._runless == {tmp_path / "notes"}
    assert entries() == searched
    assert searched[1:] == [["notes", "study/part", "tried/a.txt"], ["study", "tool.py", "tried/a.txt"]]


def test_an_ordinary_user_can_be_isolated_too(run_folder: Path) -> None:
    if os.getuid() != 0:
        pytest.skip("then the whole suite runs as one")
    own = run_folder / "r1"
    os.chown(own, 65534, 65534)
    above = Path(tempfile.gettempdir())
    for folder in (run_folder, *run_folder.parents):  # a worker's lie one deeper
        if folder.is_relative_to(above) and folder != above:
            folder.chmod(0o755)
    lines = said(
        """
        own = Path(sys.argv[1])
        os.setgroups([]); os.setgid(65534); os.setuid(65534)
        linux.prctl(4, 1)  # PR_SET_DUMPABLE, which execve would set: else /proc/self belongs to root
        isolate(own, (own.parent,))
        print(os.getuid(), (own / "kept").write_text("kept"), os.listdir(own.parent))
        print(attempt(lambda: Path("/var/tmp/scratch").write_text("1")))
        print(sorted(str(path) for path in Path("/proc").rglob("*") if path.is_file()))
        """,
        own,
    )
    about = [f"/proc/{name}" for name in ("cpuinfo", "meminfo", "sys/vm/overcommit_memory", "version")]
    assert lines == ["65534 4 ['r1']", "1", str(about)]


def test_a_process_with_threads_is_refused(run_folder: Path) -> None:
    done = run(
        """
        import threading
        threading.Thread(target=threading.Event().wait, daemon=True).start()
        isolate(Path(sys.argv[1]))
        """,
        run_folder / "r1",
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        "RuntimeError: isolate() must be called before the process starts its second thread"
    )


def test_process_exits_with_its_parent() -> None:
    # The run is over when nobody holds its stdout any more, so not before the grandchild has ended.
    done = run(
        """
        import signal
        parent = os.getpid()
        reader, writer = os.pipe()
        if os.fork() == 0:
            die_with_parent(parent)
            os.write(writer, b"tied")
            signal.pause()
        print(os.read(reader, 4).decode())
        """
    )
    assert (done.returncode, done.stdout) == (0, "tied\n")
    assert run("die_with_parent(1 if os.getppid() != 1 else 2)").returncode == -9


PROFILE = REPOSITORY / "deploy" / "container" / "seccomp.json"
DOCKER = ("mount", "mount_setattr", "pivot_root", "setns", "umount2", "unshare")
"""System calls for the sandbox that Docker's default profile blocks."""
RESTRICTED = """
from actors.runtime.isolation.syscall_filter import Instruction

def refuse(names):
    machine, column = syscall_filter._MACHINES[os.uname().machine]
    code = [Instruction(0x20, 0, 0, 0)]  # the call's number
    for name in names:
        number = syscall_filter._NUMBERS[name][column]
        if number is not None:
            code += [Instruction(0x15, 0, 1, number), syscall_filter._refuse(1)]
    syscall_filter.load([*code, syscall_filter._ALLOWED])

for capability in {*range(64)} - {*map(int, sys.argv[1].split(","))}:
    attempt(lambda: linux.prctl(linux._PR_CAPBSET_DROP, capability))
linux.prctl(linux._PR_SET_NO_NEW_PRIVS, 1)
refuse(sys.argv[2:])
print(isolation_fault())  # asks a process that is executed, and so has no capability but these
"""
CAP_SETFCAP = 31
"""Required by root to map itself into a new user namespace; not by other users."""
REFUSED = "robots cannot be isolated on this machine"


def isolation_without(*calls: str, kept: int = CAP_SETFCAP) -> str:
    need_isolation()
    (line,) = said(RESTRICTED, kept, *calls)
    return line


@pytest.mark.parametrize(
    ("calls", "failed"),
    [
        (DOCKER, "unshare of user, network, mount, IPC and process namespaces"),
        (("mount",), "mount on /"),  # as AppArmor's docker-default has it
    ],
)
def test_refused_system_call_is_named_with_a_remedy(calls: Sequence[str], failed: str) -> None:
    assert isolation_without(*calls) == (f"{REFUSED}: {failed}: Operation not permitted; {advice()}")


def test_missing_capability_of_root_is_named() -> None:
    refused = f"{REFUSED}: Operation not permitted (/proc/self/uid_map); {advice()}"
    assert isolation_without(kept=0) == ("None" if os.getuid() else refused)


def test_the_profile_for_docker_suffices() -> None:
    profile = json.loads(PROFILE.read_text())
    (rule,) = profile["syscalls"]
    action = (profile["defaultAction"], rule["action"], rule["errnoRet"])
    assert action == ("SCMP_ACT_ALLOW", "SCMP_ACT_ERRNO", 1)
    assert {"bpf", "keyctl", "ptrace", "setns"} <= {*rule["names"]}
    known = [name for name in rule["names"] if name in syscall_filter._NUMBERS]
    assert isolation_without(*known) == "None"


@pytest.mark.parametrize(
    ("variables", "files", "sort"),
    [
        ({}, (), ""),
        ({}, (".dockerenv",), "Docker"),
        ({}, ("run/.containerenv", ".dockerenv"), "Podman"),
        ({"KUBERNETES_SERVICE_HOST": "10.0.0.1"}, (".dockerenv",), "Kubernetes"),
        ({"APPTAINER_CONTAINER": "/home/ada/acrc.sif"}, (), "Apptainer"),
        ({"SINGULARITY_CONTAINER": "/acrc.sif"}, (".dockerenv",), "Apptainer"),
        ({}, (".singularity.d",), "Apptainer"),
        ({"container": "systemd-nspawn"}, (), "systemd-nspawn"),
    ],
)
def test_kind_of_container(
    variables: dict[str, str], files: Sequence[str], sort: str, tmp_path: Path
) -> None:
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert container_kind(variables, tmp_path) == sort


@pytest.mark.parametrize(
    ("sort", "sentence"),
    [
        ("", "allow unprivileged user namespaces on this machine, or run with --no-isolate"),
        ("Docker", "this is a container (Docker): start it with --security-opt "
         "seccomp=deploy/container/seccomp.json, where AppArmor is on also with --security-opt "
         "apparmor=unconfined, or run with --no-isolate"),
        ("Kubernetes",
         "this is a container (Kubernetes): give it securityContext.seccompProfile.type: Unconfined, "
         "where AppArmor is on also appArmorProfile.type: Unconfined, or run with --no-isolate"),
        ("Apptainer",
         "this is a container (Apptainer): allow unprivileged user namespaces on the machine that it runs "
         "on, or run with --no-isolate"),
        ("lxc",
         "this is a container (lxc): allow user namespaces and mounts in it, or run with --no-isolate"),
    ],
)  # fmt: skip
def test_advice_for_a_container(sort: str, sentence: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "container_kind", lambda: sort)
    monkeypatch.setattr(sandbox, "isolation_fault", lambda: f"{REFUSED}: no; {advice()}")
    assert advice() == f"{remedy()}, or run with --no-isolate" == sentence
    with refused(f"{REFUSED}: no; {sentence}"):
        choose_isolation(True)
    warning = f"robots run as plain processes, because {REFUSED}: no; {ISOLATION_RISKS}"
    assert choose_isolation(None) == IsolationChoice(False, f"{warning}; {remedy()}" if sort else warning)


def test_test_process_detects_the_container(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("APPTAINER_CONTAINER", "/acrc.sif")
    monkeypatch.setattr(
        sandbox,
        "_TEST_PROGRAM",
        "from actors.runtime.isolation.sandbox import container_kind; import sys\n"
        "sys.stderr.write(container_kind()); sys.exit(2)",
    )
    assert sandbox.isolation_fault.__wrapped__() == "Apptainer"


def test_isolation_possible_or_not_wanted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sandbox, "isolation_fault", lambda: None)
    assert choose_isolation(None) == choose_isolation(True) == IsolationChoice(True, "")
    monkeypatch.setattr(sandbox, "container_kind", lambda: "Docker")
    there = "on host lab1 robots cannot be isolated: no; allow it"
    warning = f"robots run as plain processes, because {there}; {ISOLATION_RISKS}"
    assert choose_isolation(None, elsewhere=there).warning == warning
    choice = choose_isolation(False)
    assert choice == IsolationChoice(False, f"--no-isolate: robots run as plain processes; {ISOLATION_RISKS}")
    assert (
        choose_isolation(None, debugged=True).warning
        == f"--debugpy: robots run as plain processes; {ISOLATION_RISKS}"
    )
    print_warning(choice.warning)
    print_warning("")
    assert capsys.readouterr() == ("", f"acrc: {choice.warning}\n")


def decide(code: list[Instruction], machine: int, number: int, arguments: Sequence[int] = ()) -> int:
    data = {0: number, 4: machine} | {16 + 8 * i: 0 for i in range(6)}
    data |= {16 + 8 * i: value & 0xFFFF_FFFF for i, value in enumerate(arguments)}
    accumulator, at = 0, 0
    while True:
        step = code[at]
        at += 1
        if step.code == 0x20:
            accumulator = data[step.value]
        elif step.code == 0x06:
            return step.value
        else:
            holds = {
                0x15: accumulator == step.value,
                0x35: accumulator >= step.value,
                0x45: bool(accumulator & step.value),
            }[step.code]
            at += step.if_true if holds else step.if_false


ALLOW, REFUSE = 0x7FFF_0000, 0x5_0000
DECISIONS = (
    # x86_64, aarch64, arguments, error (0: allowed)
    (0, 63, (), 0),  # read
    (62, 129, (4711, 9), 0),  # kill: the process namespace confines it
    (56, 220, (0x0100_0011,), 0),  # clone
    (56, 220, (0x1000_0011,), errno.EPERM),  # CLONE_NEWUSER
    (56, 220, (0x0002_0011,), errno.EPERM),  # CLONE_NEWNS
    (435, 435, (), errno.ENOSYS),  # clone3
    (425, 425, (), errno.ENOSYS),  # io_uring_setup
    (41, 198, (1, 1), 0),  # socket
    (41, 198, (16, 3), 0),  # AF_NETLINK
    (41, 198, (40, 1), errno.EAFNOSUPPORT),  # AF_VSOCK
    (72, 25, (3, 1), 0),  # fcntl F_GETFD
    (72, 25, (3, 1030), 0),
    (72, 25, (3, 6), errno.EPERM),  # F_SETLK
    (72, 25, (3, 37), errno.EPERM),  # F_OFD_SETLK
    (72, 25, (3, 1024), errno.EPERM),  # F_SETLEASE
    (72, 25, (3, 4711), errno.EPERM),
    (73, 32, (3, 2), errno.EPERM),  # flock
    (294, 26, (), errno.EPERM),  # inotify_init1
    (250, 219, (), errno.EPERM),  # keyctl
    (101, 117, (16, 0), errno.EPERM),  # ptrace
    (310, 270, (), errno.EPERM),  # process_vm_readv
    (438, 438, (), errno.EPERM),  # pidfd_getfd
    (272, 97, (0, 0), errno.EPERM),  # unshare
    (165, 40, (0, 0), errno.EPERM),  # mount
    (103, 116, (3,), errno.EPERM),  # syslog
    (462, 462, (), 0),  # mseal, the last reviewed call
    (463, 463, (), errno.ENOSYS),
)


@pytest.mark.parametrize("case", DECISIONS)
def test_filter_is_equal_on_both_machines(case: tuple[int, int, tuple[int, ...], int]) -> None:
    x86_64, aarch64, arguments, error = case
    intel = decide(syscall_filter.program("x86_64"), 0xC000_003E, x86_64, arguments)
    arm = decide(syscall_filter.program("aarch64"), 0xC000_00B7, aarch64, arguments)
    assert intel == arm == (REFUSE | error if error else ALLOW)


def test_calls_of_other_machines_and_of_x32_are_refused() -> None:
    intel = syscall_filter.program("x86_64")
    assert decide(intel, 0x4000_0003, 20) == REFUSE | errno.EPERM
    assert decide(intel, 0xC000_003E, 0x4000_0000 + 165) == REFUSE | errno.ENOSYS
