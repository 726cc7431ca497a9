"""The isolated process: what it keeps, what it says when it cannot be had, and each layer by itself."""

import os
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest

from actors.runtime.isolation import container
from tests.isolation.attacks import NEST, UNDO
from tests.isolation.test_attacks import need_isolation

REPOSITORY = Path(__file__).resolve().parents[2]
PRELUDE = """
import ctypes, os, sys
from pathlib import Path
from actors.runtime.isolation import mounts, sandbox, syscall_filter
from actors.runtime.lifecycle import linux
from actors.runtime.isolation.sandbox import Confinement, IsolationError, available, isolate, separate
from actors.runtime.lifecycle.linux import die_with_parent

def attempt(act):
    try:
        return act()
    except OSError as error:
        return type(error).__name__
"""


def run(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run `code` in a process of its own, with the arguments as argv[1:]."""
    return subprocess.run(
        [sys.executable, "-c", PRELUDE + textwrap.dedent(code), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def said(code: str, *arguments: object) -> list[str]:
    """The lines that `code` prints; it must end well."""
    done = run(code, *arguments)
    assert done.returncode == 0, done.stderr
    lines: list[str] = done.stdout.splitlines()
    return lines


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """A run's output folder with two robots, and beside it a map."""
    need_isolation()
    for robot in ("r1", "r2"):
        (tmp_path / "out" / robot).mkdir(parents=True)
        (tmp_path / "out" / robot / "credentials").write_text(f"{robot}:secret\n")
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "corridor.png").write_text("walls")
    return tmp_path / "out"


def test_a_sandboxed_process_keeps_its_folder_named_files_and_libraries(run_folder: Path) -> None:
    own, chart = run_folder / "r1", run_folder.parent / "maps" / "corridor.png"
    done = run(
        """
        own, chart = Path(sys.argv[1]), Path(sys.argv[2])
        folder = os.open(own.parent, os.O_RDONLY)
        isolate(Confinement(own=own, hidden=(own.parent,), readable=(chart,), log=own / "log.txt"))
        nothing = os.stat(os.devnull).st_rdev
        print(os.fstat(folder).st_rdev == nothing, os.fstat(0).st_rdev == nothing)
        print(Path.cwd() == own, sorted(path.name for path in own.parent.iterdir()))
        print((own / "recording.mcap").write_text("kept"))
        for path in (own.parent / "lost", Path("/etc/lost"), chart):
            print(attempt(lambda: path.write_text("")))
        print((Path("/tmp") / "scratch").write_text("gone"))
        print(chart.read_text(), sorted(path.name for path in chart.parent.iterdir()))
        import subprocess, threading
        import numpy, zenoh
        print(numpy.ones((300, 300)).dot(numpy.ones((300, 300)))[0, 0])
        child = subprocess.run([sys.executable, "-c", "print(1)"], capture_output=True, text=True)
        print(os.cpu_count() > 0, child.stdout.strip(), len(os.urandom(4)), os.listdir("/sys"))
        thread = threading.Thread(target=print, args=("thread",)); thread.start(); thread.join()
        sys.stdout.flush()
        print("a traceback", file=sys.stderr)
        """,
        own,
        chart,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (own / "log.txt").read_text().splitlines() == [
        *("True True", "True ['r1']", "4", "OSError", "OSError", "OSError", "4", "walls ['corridor.png']"),
        *("300.0", "True 1 4 ['devices']", "thread", "a traceback"),
    ]
    assert (own / "recording.mcap").read_text() == "kept"
    assert not Path("/tmp/scratch").exists()


def test_without_mount_setattr_the_tree_is_made_readonly_mount_by_mount(run_folder: Path) -> None:
    lines = said(
        """
        import errno
        def too_old(path):
            raise OSError(errno.ENOSYS, "mount_setattr")
        linux.set_tree_readonly = too_old
        isolate(Confinement(own=Path(sys.argv[1])))
        for folder in ("/etc", "/dev/pts", sys.argv[2]):
            print(attempt(lambda: Path(folder, "lost").write_text("")))
        print(Path(sys.argv[1], "kept").write_text("kept"))
        """,
        run_folder / "r1",
        REPOSITORY,
    )
    assert lines == ["OSError", "FileNotFoundError", "OSError", "4"]


BREAKS = {
    # What is in force before the attempt, how the attempt begins, what it says.
    "the attempt itself, with all capabilities": ("separate(plan)", "", ["written"]),
    "no filter": ("separate(plan); linux.drop_capabilities()", NEST, ["nested"]),
    "everything": ("isolate(plan)", NEST, []),
}


@pytest.mark.parametrize("name", BREAKS)
def test_a_nested_user_namespace_does_not_undo_the_file_tree(name: str, run_folder: Path) -> None:
    in_force, begin, outcome = BREAKS[name]
    code = """
        own = Path(sys.argv[1])
        plan = Confinement(own=own, hidden=(own.parent,))
        exec(sys.argv[2])
        code = sys.argv[3]
        sys.argv = ["-c", sys.argv[4], "lost", str(own.parent)]
        exec(code)
        """
    try:
        assert said(code, run_folder / "r1", in_force, begin + UNDO, REPOSITORY) == outcome
    finally:
        (REPOSITORY / ".lost").unlink(missing_ok=True)


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
        isolate(Confinement(own=own, hidden=(own.parent,)))
        print(os.getuid(), (own / "kept").write_text("kept"), os.listdir(own.parent))
        print(attempt(lambda: Path("/var/tmp/scratch").write_text("1")))
        print(sorted(str(path) for path in Path("/proc").rglob("*") if path.is_file()))
        """,
        own,
    )
    about = [f"/proc/{name}" for name in ("cpuinfo", "meminfo", "sys/vm/overcommit_memory", "version")]
    assert lines == ["65534 4 ['r1']", "1", str(about)]


def test_the_error_names_what_failed_and_the_way_round(run_folder: Path) -> None:
    lines = said(
        """
        linux.prctl(38, 1)  # PR_SET_NO_NEW_PRIVS
        syscall_filter.install()
        try:
            isolate(Confinement(own=Path(sys.argv[1])))
        except IsolationError as error:
            error_said = error
        print(error_said)
        print(available() == str(error_said))
        """,
        run_folder / "r1",
    )
    assert lines == [
        "robots cannot be isolated on this machine: unshare of user, network, mount, IPC and process "
        f"namespaces: Operation not permitted; {container.advice()}",
        "True",
    ]


def test_a_process_with_threads_is_refused(run_folder: Path) -> None:
    done = run(
        """
        import threading
        threading.Thread(target=threading.Event().wait, daemon=True).start()
        isolate(Confinement(own=Path(sys.argv[1])))
        """,
        run_folder / "r1",
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        "RuntimeError: isolate() must be called before the process starts its second thread"
    )


def test_a_process_dies_with_its_parent() -> None:
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


def test_a_process_whose_parent_is_gone_ends_at_once() -> None:
    assert run("die_with_parent(1 if os.getppid() != 1 else 2)").returncode == -9
