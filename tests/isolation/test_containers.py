"""What sandbox robots have in containers, by whose restrictions a process is held, and what is said of it."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.runtime.isolation import container, sandbox, syscall_filter
from actors.runtime.isolation.sandbox import OPEN, IsolationChoice, choose, warn
from tests.isolation.test_attacks import need_isolation
from tests.isolation.test_process import said

PROFILE = REPOSITORY / "deploy" / "container" / "seccomp.json"
DOCKER = ("mount", "mount_setattr", "pivot_root", "setns", "umount2", "unshare")
"""What Docker's default profile refuses of what a sandbox is made with."""
DOCKER_SYS_ADMIN = ("pivot_root",)
"""What it still refuses with `--cap-add SYS_ADMIN`."""
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
print(available())  # asks a process that is executed, and so has no capability but these
"""
CAP_SETFCAP = 31
"""Without it root maps itself into no new namespace; other users need none."""
REFUSED = "robots cannot be isolated on this machine"


def isolation_without(*calls: str, kept: int = CAP_SETFCAP) -> str:
    """What `available` says where no capability but `kept` is left and these calls are refused."""
    need_isolation()
    (line,) = said(RESTRICTED, kept, *calls)
    return line


@pytest.mark.parametrize(
    ("calls", "failed"),
    [
        (DOCKER, "unshare of user, network, mount, IPC and process namespaces"),
        (DOCKER_SYS_ADMIN, "pivot_root to /dev"),
        (("mount",), "mount on /"),  # as AppArmor's docker-default has it
    ],
)
def test_what_a_container_refuses_is_named_with_what_would_help(calls: Sequence[str], failed: str) -> None:
    assert isolation_without(*calls) == (
        f"{REFUSED}: {failed}: Operation not permitted; {container.advice()}"
    )


def test_without_capabilities_and_with_no_new_privileges_robots_are_isolated_as_in_apptainer() -> None:
    assert isolation_without() == "None"


def test_root_without_capabilities_is_told_what_it_lacks_and_others_lack_nothing() -> None:
    refused = f"{REFUSED}: Operation not permitted (/proc/self/uid_map); {container.advice()}"
    assert isolation_without(kept=0) == ("None" if os.getuid() else refused)


def test_the_profile_for_docker_suffices() -> None:
    profile = json.loads(PROFILE.read_text())
    (rule,) = profile["syscalls"]
    assert (profile["defaultAction"], rule["action"], rule["errnoRet"]) == (
        "SCMP_ACT_ALLOW",
        "SCMP_ACT_ERRNO",
        1,
    )
    assert {"bpf", "keyctl", "ptrace", "setns"} <= {*rule["names"]}
    known = [name for name in rule["names"] if name in syscall_filter._NUMBERS]
    assert isolation_without(*known) == "None"


@pytest.mark.parametrize(
    ("variables", "files", "sort"),
    [
        ({}, (), ""),
        ({"container": ""}, (), ""),
        ({}, (".dockerenv",), "Docker"),
        ({}, ("run/.containerenv", ".dockerenv"), "Podman"),
        ({"container": "podman"}, (), "Podman"),
        ({"KUBERNETES_SERVICE_HOST": "10.0.0.1"}, (".dockerenv",), "Kubernetes"),
        ({"APPTAINER_CONTAINER": "/home/ada/acrc.sif"}, (), "Apptainer"),
        ({"SINGULARITY_CONTAINER": "/acrc.sif"}, (".dockerenv",), "Apptainer"),
        ({}, (".singularity.d",), "Apptainer"),
        ({"container": "systemd-nspawn"}, (), "systemd-nspawn"),
    ],
)
def test_a_container_is_told_from_another(
    variables: dict[str, str], files: Sequence[str], sort: str, tmp_path: Path
) -> None:
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert container.kind(variables, tmp_path) == sort


@pytest.mark.parametrize(
    ("sort", "sentence"),
    [
        ("", "allow unprivileged user namespaces on this machine, or run with --no-isolate"),
        (
            "Docker",
            "this is a container (Docker): start it with --security-opt "
            "seccomp=deploy/container/seccomp.json, where AppArmor is on also with --security-opt "
            "apparmor=unconfined, or run with --no-isolate",
        ),
        (
            "Kubernetes",
            "this is a container (Kubernetes): give it securityContext.seccompProfile.type: Unconfined, "
            "where AppArmor is on also appArmorProfile.type: Unconfined, or run with --no-isolate",
        ),
        (
            "Apptainer",
            "this is a container (Apptainer): allow unprivileged user namespaces on the machine that it runs "
            "on, or run with --no-isolate",
        ),
        (
            "lxc",
            "this is a container (lxc): let it make user namespaces and mounts, or run with --no-isolate",
        ),
    ],
)
def test_a_container_is_named_with_what_it_is_to_be_started_with(
    sort: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(container, "kind", lambda: sort)
    monkeypatch.setattr(sandbox, "available", lambda: f"{REFUSED}: no; {container.advice()}")
    assert container.advice() == f"{container.remedy()}, or run with --no-isolate" == sentence
    with pytest.raises(sandbox.IsolationError) as caught:
        choose(True)
    assert str(caught.value) == f"{REFUSED}: no; {sentence}"
    warning = f"robots run as plain processes, because {REFUSED}: no; {OPEN}"
    assert choose(None) == IsolationChoice(False, f"{warning}; {container.remedy()}" if sort else warning)


def test_the_trial_in_a_process_of_its_own_knows_the_container(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("APPTAINER_CONTAINER", "/acrc.sif")
    monkeypatch.setattr(
        sandbox, "_TRIAL", "from actors.runtime.isolation import container; print(container.kind()); exit(1)"
    )
    assert sandbox.available() == "Apptainer"


def test_what_another_computer_says_of_its_container_is_not_said_of_this_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(container, "kind", lambda: "Docker")
    monkeypatch.setattr(sandbox, "available", lambda: None)
    there = "on host lab1 robots cannot be isolated: no; allow it"
    assert choose(None, elsewhere=there).warning == (
        f"robots run as plain processes, because {there}; {OPEN}"
    )


def test_isolation_where_it_is_possible_or_not_wanted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sandbox, "available", lambda: None)
    assert choose(None) == choose(True) == IsolationChoice(True, "")
    choice = choose(False)
    assert choice == IsolationChoice(False, f"--no-isolate: robots run as plain processes; {OPEN}")
    assert choose(None, debugged=True).warning == f"--debugpy: robots run as plain processes; {OPEN}"
    warn(choice.warning)
    warn("")
    assert capsys.readouterr() == ("", f"acrc: {choice.warning}\n")
