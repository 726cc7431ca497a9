"""Shells over the in-memory bus: barrier, counts, digest, recordings and replay."""

import random
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest

from actors.introspection import Introspection, PerceptionSample
from actors.messages import AIRED, DRIVE, INTROSPECTION, SENSES, Drive, Odometry, SensorData
from actors.runtime.codec import decode, encode
from actors.runtime.core import Address, Delivery, Inputs, Output, at, read, to
from actors.runtime.errors import AcrcError
from actors.runtime.recording import (
    Entry,
    Note,
    NullJournal,
    Recorder,
    RecordingError,
    read_notes,
    read_recording,
)
from actors.runtime.replay_bus import ReplayBus, ReplayError, replay
from actors.runtime.shell import MemoryBus, Shell, run_digest, run_shells

ROBOTS = ("r1", "r22", "r333")


AT_REST = Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Caller:
    """Sends SensorData to all and awaits Drive from all, `steps` times; then halts all."""

    def __init__(self, robots: Sequence[str], steps: int) -> None:
        self.step = 0
        self.finished = False
        self.speeds: list[list[float]] = []
        self._robots = robots
        self._steps = steps
        self._called = False

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return no address before the call, every answer after it."""
        if not self._called:
            return ()
        return [at(DRIVE, robot) for robot in self._robots if DRIVE.key(robot) not in have]

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Send the call, or use the answers."""
        if self._called:
            self.speeds.append([read(inputs, DRIVE, robot).vx for robot in self._robots])
            self.step += 1
            self._called = False
            return ()
        halt = self.step == self._steps
        self.finished = halt
        self._called = True
        senses = SensorData(self.step, self.step * 1000, 0, AT_REST, 0, None, halt)
        return [to(SENSES, senses, robot) for robot in self._robots]


class Answerer:
    """Answers each call with a speed that depends on the step and on its name."""

    def __init__(self, robot: str) -> None:
        self.step = 0
        self.finished = False
        self._robot = robot

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return the address of the call."""
        return () if have else (at(SENSES, self._robot),)

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Answer it."""
        senses = read(inputs, SENSES, self._robot)
        if senses.halt:
            self.finished = True
            return ()
        self.step += 1
        speed = senses.step + len(self._robot) / 10
        return (to(DRIVE, Drive(senses.step, speed, 0.0, 0.0, 0), self._robot),)


class Introspective(Answerer):
    """Also sends recorded-only messages."""

    def __init__(self, robot: str, noise: int) -> None:
        super().__init__(robot)
        self._noise = noise

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        step = self.step
        outputs = super().advance(inputs)
        size = self._noise * step
        sample = PerceptionSample(None, None, random.Random(step).randbytes(size), None)
        told = Introspection(step, sample=sample)
        return (to(INTROSPECTION, told, self._robot), *outputs) if outputs else ()


class LossyBus(MemoryBus):
    """Drops the n-th message."""

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
    caller = Shell(Caller(ROBOTS, steps), bus, journal.get("world", NullJournal()), actor="world")
    bus.listen(at(DRIVE, "*"), caller.deliver)
    shells = [caller]
    for robot in ROBOTS:
        shell = Shell(Answerer(robot), bus, journal.get(robot, NullJournal()), actor=robot)
        bus.listen(at(SENSES, robot), shell.deliver)
        shells.append(shell)
    return shells


def digest(shells: list[Shell]) -> str:
    return run_digest([shell.counts.hash.digest(shell.actor) for shell in shells])


def undelivered(shells: list[Shell]) -> int:
    return sum(shell.counts.published - shell.counts.received for shell in shells)


def test_every_answer_reaches_the_caller_in_its_step() -> None:
    shells = swarm(MemoryBus(), 5)
    run_shells(shells)
    assert shells[0].core.speeds == [[k + 0.2, k + 0.3, k + 0.4] for k in range(5)]  # type: ignore[attr-defined]
    assert undelivered(shells) == 0


class Mixed(Caller):
    """Also awaits another family of keys."""

    def missing(self, have: Inputs) -> Sequence[Address]:
        return [*super().missing(have), at(AIRED)] if self._called else []


def test_answered_actor_is_no_longer_awaited() -> None:
    shell = Shell(Mixed(ROBOTS, 1), MemoryBus(), NullJournal(), actor="world")
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
        "no actor can continue: world (step 0) waits for swarm/up/r22/drive; r1 (step 1) waits for "
        "swarm/down/r1/senses; r22 (step 1) waits for swarm/down/r22/senses; r333 (step 1) waits for "
        "swarm/down/r333/senses"
    )
    assert undelivered(shells) == 1


@pytest.mark.parametrize(
    ("senders", "limit", "error"),
    [
        (1, Shell.KEY_LIMIT, "step 0: r0 floods swarm/up/r0/drive: r1 has 5000 unread messages from "
         "this key; at most 5000 are allowed"),
        (30, Shell.INBOX_LIMIT, "r1 has 100000 unread messages"),
    ],
)  # fmt: skip
def test_growing_inbox_is_an_error(senders: int, limit: int, error: str) -> None:
    shell = Shell(Answerer("r1"), MemoryBus(), NullJournal(), actor="r1")
    with pytest.raises(AcrcError, match=error):
        for number in range(limit + 1):
            shell.deliver(Delivery(DRIVE, f"swarm/up/r{number % senders}/drive", b""))  # type: ignore[arg-type]
    assert number == limit


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


def test_invalid_recording_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as missing:
        list(read_recording(tmp_path / "none.mcap"))
    assert str(missing.value) == f"{tmp_path / 'none.mcap'}: no such recording"
    (tmp_path / "text.mcap").write_text("hello, this is no recording")
    with pytest.raises(RecordingError, match=r"text\.mcap: not a recording, or damaged"):
        list(read_recording(tmp_path / "text.mcap"))


def test_a_replay_gives_the_recorded_outputs(recorded: tuple[Path, list[Shell]]) -> None:
    folder, _ = recorded
    bus = ReplayBus(folder / "r22.mcap")
    shell = Shell(Answerer("r22"), bus, NullJournal(), actor="r22")
    replay(shell, bus)
    assert shell.finished and bus.compared == 4


def test_recorded_only_message_is_recorded_and_not_published(tmp_path: Path) -> None:
    bus, path = MemoryBus(), tmp_path / "r22.mcap"
    plain = swarm(MemoryBus(), 5)
    run_shells(plain)
    with Recorder(path, 1000) as recorder:
        caller = Shell(Caller(("r22",), 5), bus, NullJournal(), actor="world")
        shell = Shell(Introspective("r22", 50_000), bus, recorder, actor="r22")
        bus.listen(at(DRIVE, "*"), caller.deliver)
        bus.listen(at(SENSES, "r22"), shell.deliver)
        run_shells([caller, shell])
    assert shell.counts.hash.digest("r22") == plain[2].counts.hash.digest("r22")
    assert shell.counts.published == plain[2].counts.published
    kept = [
        one for one in read_recording(path) if isinstance(one, Entry) and one.key == INTROSPECTION.key("r22")
    ]
    assert [(one.step, one.sequence) for one in kept] == [(step, step) for step in range(5)]
    for one in kept:
        assert one.payload is not None
        told = decode(INTROSPECTION, one.key, one.payload)  # type: ignore[arg-type]
        assert isinstance(told, Introspection)
        assert told.sample is not None
        assert told.sample.plan == random.Random(one.step).randbytes(50_000 * one.step)
    again = ReplayBus(path)
    replay(Shell(Introspective("r22", 50_000), again, again, actor="r22"), again)
    assert again.compared == 10
    other = ReplayBus(path)
    with pytest.raises(ReplayError, match=r"step 1: swarm/up/r22/introspection: Introspection.sample"):
        replay(Shell(Introspective("r22", 50_001), other, other, actor="r22"), other)


def test_a_replay_names_the_first_difference(recorded: tuple[Path, list[Shell]]) -> None:
    path = recorded[0] / "r22.mcap"

    class Faulty(Answerer):
        def __init__(self, fault: Callable[[Sequence[Output]], Sequence[Output]]) -> None:
            super().__init__("r22")
            self.fault = fault

        def advance(self, inputs):  # type: ignore[no-untyped-def]
            outputs = super().advance(inputs)
            return outputs if self.step != 4 else self.fault(outputs)

    def other_speed(outputs: Sequence[Output]) -> Sequence[Output]:
        replace = msgspec.structs.replace
        return [replace(one, message=replace(one.message, vx=0.0)) for one in outputs]

    for fault, difference in (
        (other_speed, "swarm/up/r22/drive: Drive.vx is 0.0, recorded was 3.3"),
        (lambda outputs: (), "does not send the recorded message on swarm/up/r22/drive"),
    ):
        bus = ReplayBus(path)
        with pytest.raises(ReplayError) as caught:
            replay(Shell(Faulty(fault), bus, NullJournal(), actor="r22"), bus)
        assert str(caught.value) == f"{path}: step 3: {difference}"
