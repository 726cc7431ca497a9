"""Shells over the memory bus: the barrier, the counts, the digest, the recordings and their replay."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from actors.messages import AIRED, DRIVE, SENSES, Drive
from actors.runtime.bus.memory_bus import MemoryBus, run_shells
from actors.runtime.bus.replay_bus import ReplayBus, ReplayError, replay
from actors.runtime.bus_interface import Delivery
from actors.runtime.codec import encode
from actors.runtime.core import Address, Inputs, at
from actors.runtime.errors import AcrcError
from actors.runtime.message_counts import run_digest
from actors.runtime.recording import (
    Entry,
    Note,
    Recorder,
    RecordingError,
    Unrecorded,
    read_notes,
    read_recording,
)
from actors.runtime.shell import Shell
from tests.runtime.toys import Answerer, Caller

ROBOTS = ("r1", "r22", "r333")


class LossyBus(MemoryBus):
    """Loses the n-th message it is given."""

    def __init__(self, lost: int) -> None:
        super().__init__()
        self._left = lost

    def publish(self, key: str, payload: bytes) -> None:
        self._left -= 1
        if self._left != 0:
            super().publish(key, payload)


class Words(msgspec.Struct):
    text: str


def swarm(bus: MemoryBus, steps: int, recorders: dict[str, Recorder] | None = None) -> list[Shell]:
    journal = recorders or {}
    caller = Shell(Caller(ROBOTS, steps), bus, journal.get("world", Unrecorded()), actor="world")
    bus.listen(at(DRIVE, "*"), caller.deliver)
    shells = [caller]
    for robot in ROBOTS:
        shell = Shell(Answerer(robot), bus, journal.get(robot, Unrecorded()), actor=robot)
        bus.listen(at(SENSES, robot), shell.deliver)
        shells.append(shell)
    return shells


def digest(shells: list[Shell]) -> str:
    return run_digest([shell.tally.hash.digest(shell.actor) for shell in shells])


def undelivered(shells: list[Shell]) -> int:
    return sum(shell.tally.published - shell.tally.received for shell in shells)


def test_every_answer_reaches_the_caller_in_its_step() -> None:
    shells = swarm(MemoryBus(), 5)
    run_shells(shells)
    assert shells[0].core.speeds == [[k + 0.2, k + 0.3, k + 0.4] for k in range(5)]  # type: ignore[attr-defined]
    assert undelivered(shells) == 0


class Mixed(Caller):
    """Awaits another family of keys, too."""

    def missing(self, have: Inputs) -> Sequence[Address]:
        return [*super().missing(have), at(AIRED)] if self._called else []


def test_who_has_answered_is_awaited_no_more_though_one_before_has_not() -> None:
    shell = Shell(Mixed(ROBOTS, 1), MemoryBus(), Unrecorded(), actor="world")
    drives = {robot: encode(Drive(0, 0.1, 0.0, 0.0, 0), DRIVE.key(robot)) for robot in ROBOTS}
    shell.pump()
    awaited = []
    for robot in (None, "r333", "r22", "r1"):
        if robot is not None:
            shell.deliver(Delivery(at(DRIVE, robot).topic, DRIVE.key(robot), drives[robot]))
        shell.pump()
        awaited.append([address.robot for address in shell.awaited])
    assert awaited == [["r1", "r22", "r333"], ["r1", "r22"], ["r1"], [""]]


def test_the_order_in_which_shells_run_does_not_matter() -> None:
    forward, backward = swarm(MemoryBus(), 20), swarm(MemoryBus(), 20)
    run_shells(forward)
    run_shells(backward[::-1])
    assert digest(forward) == digest(backward)
    other = swarm(MemoryBus(), 21)
    run_shells(other)
    assert digest(other) != digest(forward)


def test_a_lost_message_is_named_and_counted() -> None:
    shells = swarm(LossyBus(lost=5), 3)
    with pytest.raises(AcrcError) as caught:
        run_shells(shells)
    assert str(caught.value) == (
        "nobody can go on: world (step 0) for swarm/up/r22/drive; r1 (step 1) for swarm/down/r1/senses; "
        "r22 (step 1) for swarm/down/r22/senses; r333 (step 1) for swarm/down/r333/senses is awaited and "
        "never sent"
    )
    assert undelivered(shells) == 1


def test_an_inbox_that_only_grows_is_an_error() -> None:
    shell = Shell(Answerer("r1"), MemoryBus(), Unrecorded(), actor="r1")
    delivery = Delivery(DRIVE, "swarm/up/r2/drive", b"")  # type: ignore[arg-type]
    for _ in range(Shell.KEY_LIMIT):
        shell.deliver(delivery)
    with pytest.raises(AcrcError) as caught:
        shell.deliver(delivery)
    assert str(caught.value) == (
        "step 0: r2 floods swarm/up/r2/drive: r1 has 5000 messages from there and has asked for none of "
        "them; at most 5000 may wait"
    )


def test_many_inboxes_that_grow_are_an_error_too() -> None:
    shell = Shell(Answerer("r1"), MemoryBus(), Unrecorded(), actor="r1")
    with pytest.raises(AcrcError, match="r1 has 100000 messages waiting"):
        for number in range(Shell.INBOX_LIMIT + 1):
            shell.deliver(Delivery(DRIVE, f"swarm/up/r{number % 30}/drive", b""))  # type: ignore[arg-type]


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[Path, list[Shell]]:
    recorders = {name: Recorder(tmp_path / f"{name}.mcap", 1000) for name in ("world", *ROBOTS)}
    shells = swarm(MemoryBus(), 4, recorders)
    for recorder in recorders.values():
        recorder.note("run", Words("first"))
    run_shells(shells)
    for recorder in recorders.values():
        with recorder:
            recorder.note("final", Words("last"))
    return tmp_path, shells


def test_a_recording_holds_everything_in_order(recorded: tuple[Path, list[Shell]]) -> None:
    folder, _ = recorded
    items = list(read_recording(folder / "r1.mcap"))
    assert items[0] == Note("run", '{"text":"first"}') and items[-1] == Note("final", '{"text":"last"}')
    entries = [item for item in items if isinstance(item, Entry)]
    assert [(e.direction, e.step, e.sequence) for e in entries] == [
        *((way, k, k) for k in range(4) for way in ("in", "out")),
        ("in", 4, 4),
    ]
    assert entries[1].payload == encode(Drive(0, 0.2, 0.0, 0.0, 0))
    assert read_notes(folder / "r1.mcap") == {"run": '{"text":"first"}', "final": '{"text":"last"}'}


def test_a_recording_that_was_cut_reads_up_to_the_cut(recorded: tuple[Path, list[Shell]]) -> None:
    folder, _ = recorded
    whole = (folder / "r1.mcap").read_bytes()
    total = len(list(read_recording(folder / "r1.mcap")))
    cut = folder / "cut.mcap"
    counts = []
    for length in range(8, len(whole), 7):
        cut.write_bytes(whole[:length])
        counts.append(len(list(read_recording(cut))))
    assert counts == sorted(counts) and counts[0] == 0 and counts[-1] == total


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as missing:
        list(read_recording(tmp_path / "none.mcap"))
    assert str(missing.value) == f"{tmp_path / 'none.mcap'}: no such recording"
    (tmp_path / "text.mcap").write_text("hello, this is no recording")
    with pytest.raises(RecordingError, match=r"text\.mcap: not a recording of this project, or damaged"):
        list(read_recording(tmp_path / "text.mcap"))


def test_a_replay_gives_the_recorded_outputs(recorded: tuple[Path, list[Shell]]) -> None:
    folder, _ = recorded
    bus = ReplayBus(folder / "r22.mcap")
    shell = Shell(Answerer("r22"), bus, Unrecorded(), actor="r22")
    replay(shell, bus)
    assert shell.finished and bus.compared == 4


def test_a_replay_with_other_code_names_the_first_difference(recorded: tuple[Path, list[Shell]]) -> None:
    folder, _ = recorded

    class Slower(Answerer):
        def __init__(self) -> None:
            super().__init__("r22")
            self._robot = "r22"

        def advance(self, inputs):  # type: ignore[no-untyped-def]
            outputs = super().advance(inputs)
            if self.step < 3:
                return outputs
            return [
                msgspec.structs.replace(o, message=msgspec.structs.replace(o.message, vx=0.0))
                for o in outputs
            ]

    bus = ReplayBus(folder / "r22.mcap")
    with pytest.raises(ReplayError) as caught:
        replay(Shell(Slower(), bus, Unrecorded(), actor="r22"), bus)
    assert str(caught.value) == (
        f"{folder / 'r22.mcap'}: step 2: swarm/up/r22/drive: Drive.vx is 0.0; recorded was 2.3"
    )


def test_a_replay_that_sends_too_little_is_noticed(recorded: tuple[Path, list[Shell]]) -> None:
    folder, _ = recorded

    class Quiet(Answerer):
        def advance(self, inputs):  # type: ignore[no-untyped-def]
            outputs = super().advance(inputs)
            return () if self.step == 4 else outputs

    bus = ReplayBus(folder / "r1.mcap")
    with pytest.raises(ReplayError) as caught:
        replay(Shell(Quiet("r1"), bus, Unrecorded(), actor="r1"), bus)
    assert str(caught.value) == (
        f"{folder / 'r1.mcap'}: step 3: does not send again what was recorded on swarm/up/r1/drive"
    )
