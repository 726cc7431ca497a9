"""Who is started again: processes that are played, for what counts is the order in which they end."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from actors.processes.launch import Child, Program
from actors.runtime.errors import AcrcError
from deploy.fleet import onboard as layout
from deploy.fleet.onboard import Onboard
from deploy.fleet.onboard_supervisor import OnboardSupervisor


class Robot:
    """Stands for what is laid out; nothing of it is on the disk."""

    id = "r1"


class Played:
    """A launcher whose processes end when the test says so; `wait` lets the next ones end."""

    def __init__(self) -> None:
        self.started: list[str] = []
        self.children: dict[str, Child] = {}
        self.ends: list[dict[str, int]] = []
        self.said: list[str] = []

    def withdraw(self, router: Path) -> None:
        """Nothing is laid out."""

    def start(self, program: Program) -> Child:
        self.started.append(program.actor)
        self.children[program.actor] = Child(program, pid=2**22 + len(self.started))
        return self.children[program.actor]

    def wait(self, _timeout_s: float) -> None:
        for name, code in (self.ends.pop(0) if self.ends else {}).items():
            self.children[name].exit_code = code


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[OnboardSupervisor, Played]:
    """A robot whose base, bridge and program run."""

    issued = SimpleNamespace(sockets={layout.BRIDGE: tmp_path})

    def program(name: str) -> object:
        return lambda _onboard, _start: Program(
            name, name, (), tmp_path / f"{name}.log", tmp_path / f"{name}.mcap"
        )

    monkeypatch.setattr(OnboardSupervisor, "GRACE_S", 0.05)  # nothing is really waited for
    monkeypatch.setattr(layout, "issue", lambda _onboard: issued)
    monkeypatch.setattr(layout, "base_program", program(layout.BASE))
    monkeypatch.setattr(layout, "bridge_program", program(layout.BRIDGE))
    monkeypatch.setattr(layout, "onboard_robot_program", program("r1"))
    onboard: Onboard = type("One", (), {"robot": Robot, "router": Path("router.json")})()
    launcher = Played()
    watch = OnboardSupervisor(onboard, launcher, launcher.said.append)  # type: ignore[arg-type]
    watch.start()
    assert launcher.started == [layout.BASE, layout.BRIDGE, "r1"]
    return watch, launcher


def test_a_robot_that_has_finished_is_not_started_again_while_its_base_still_ends(
    played: tuple[OnboardSupervisor, Played],
) -> None:
    watch, launcher = played
    launcher.ends = [{"r1": 0}, {}, {layout.BRIDGE: 0}, {layout.BASE: 0}]
    assert not watch.look(0.0), "told to stop"
    assert launcher.started == [layout.BASE, layout.BRIDGE, "r1"]
    assert watch.restarts == 0


TAKEN = "base failed in step 0: /dev/kobuki: another program has the port open"


def test_why_a_process_has_ended_is_said_each_time_and_in_the_end(
    played: tuple[OnboardSupervisor, Played], tmp_path: Path
) -> None:
    watch, launcher = played
    (tmp_path / "r1.log").write_text(f"what it prints\n{TAKEN}\n")
    launcher.ends = [{"r1": 1}] * 6
    with pytest.raises(AcrcError) as caught:
        while True:
            watch.look(0.0)
    assert launcher.said == [f"r1 has ended with exit code 1: {TAKEN}"] * 6
    assert str(caught.value) == (
        "r1: its processes were started 5 times within 60 s, and r1 has ended once more with exit code 1: "
        f"{TAKEN}"
    )


def test_a_recording_that_is_not_whole_is_told_once_for_each_thing_that_its_process_says(
    played: tuple[OnboardSupervisor, Played], tmp_path: Path
) -> None:
    watch, launcher = played
    full = f"{tmp_path}/r1.mcap: cannot be written: no space left on device"
    log = tmp_path / "r1.log"
    later = "and this was said after it, before anybody looked\n"
    for text in ("a line of the strategy\n", f"{full}; records are lost from here on\n{later}", "", ""):
        log.write_text((log.read_text() if log.exists() else "") + text)
        assert watch.look(0.0)
    log.write_text(log.read_text() + f"{full}; 1234 records are missing\n")
    launcher.ends = [{"r1": 0, layout.BRIDGE: 0, layout.BASE: 0}]
    assert not watch.look(0.0)
    assert launcher.said == [
        f"r1: {full}; records are lost from here on",
        f"r1: {full}; 1234 records are missing",
    ]
