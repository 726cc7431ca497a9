"""Every bus delivers the same bytes, or rejects a message with the same error."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

from actors.items import REASON_LIMIT, ItemGivenUp, ItemKey
from actors.messages import DRIVE, Drive
from actors.runtime.codec import MESSAGE_LIMIT, encode
from actors.runtime.core import Address, Inputs, Outlet, Output, at, to
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.rules import session_config, set_value
from actors.runtime.recording import Journal, NullJournal, Recorder
from actors.runtime.replay_bus import ReplayBus
from actors.runtime.shell import MemoryBus, Shell
from actors.runtime.zenoh_bus import open_mesh
from cleaning.place import VisitReport

ROBOT = "r" * 32
KEY = DRIVE.key(ROBOT)
Send = Callable[[Drive], str]
"""Function that sends a message and returns the delivered bytes, or the error."""


class Speaker:
    """A core that sends one message."""

    def __init__(self, message: Drive) -> None:
        self.step = 0
        self.finished = False
        self._message = message

    def missing(self, have: Inputs) -> Sequence[Address]:
        return ()

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        self.finished = True
        return (to(DRIVE, self._message, ROBOT),)


def say(message: Drive, outlet: Outlet, journal: Journal | None = None) -> str:
    """Return the error of sending; "" if the message was sent."""
    try:
        Shell(Speaker(message), outlet, journal or NullJournal(), actor=ROBOT).pump()
    except AcrcError as error:
        return str(error)
    return ""


def over_memory(message: Drive) -> str:
    """Send over the in-memory bus."""
    arrived: list[bytes] = []
    bus = MemoryBus()
    bus.listen(at(DRIVE, "*"), lambda delivery: arrived.append(delivery.payload))
    return say(message, bus) or arrived[0].hex()


def over_replay(message: Drive, folder: Path) -> str:
    """Record a message and replay it, which compares the recorded bytes."""
    path = folder / f"{time.monotonic_ns()}.mcap"
    with Recorder(path, 1000) as recorder:
        refused = say(message, MemoryBus(), recorder)
    bus = ReplayBus(path)
    again = say(message, bus)
    bus.close()
    assert again == refused and bus.compared == (not refused)
    return again or encode(message).hex()


@pytest.fixture(scope="module")
def over_zenoh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Send]:
    """Send from a client to the router, as from a robot to the world."""
    endpoint = f"unixsock-stream/{tmp_path_factory.mktemp('z') / 'r.sock'}"
    router, client = session_config("router"), session_config("client")
    set_value(router, "listen/endpoints", [endpoint])
    set_value(router, "scouting/delay", 0)
    set_value(client, "connect/endpoints", [endpoint])
    set_value(client, "listen/endpoints", [])
    with ExitStack() as stack:
        world = stack.enter_context(open_mesh(router, [at(DRIVE, "*")], patience_s=5.0))
        robot = stack.enter_context(open_mesh(client, [], patience_s=5.0))

        def send(message: Drive) -> str:
            refused = say(message, robot)
            if refused:
                return refused
            deadline = time.monotonic() + 10
            while (delivery := world.poll(at(DRIVE).topic)) is None:
                assert time.monotonic() < deadline, "it was sent, and never arrived"
                time.sleep(0.001)
            assert delivery.key == KEY
            return delivery.payload.hex()

        yield send


def several(one: some.SearchStrategy[Any], most: int) -> some.SearchStrategy[tuple[Any, ...]]:
    """Draw a few different ones, or many equal ones, up to beyond every limit."""
    many = some.builds(lambda item, count: (item,) * count, one, some.integers(0, most))
    return some.lists(one, max_size=5).map(tuple) | many


NAMES = some.text(min_size=1, max_size=32)
NUMBERS = some.integers(0, 2**63) | some.integers(0, 1000).map(np.int64)
FLOATS = some.floats() | some.floats(allow_nan=False).map(np.float64)
REASONS = some.text(alphabet=some.characters(), min_size=1, max_size=REASON_LIMIT)
DRIVES = some.builds(
    Drive,
    some.integers(0, 2**40),
    FLOATS,
    FLOATS,
    FLOATS,
    NUMBERS,
    several(some.builds(VisitReport, NAMES, NUMBERS, NUMBERS), 1000),
    several(some.builds(ItemGivenUp, NAMES, NUMBERS, NUMBERS, REASONS), 1000),
    some.none() | several(some.builds(ItemKey, NAMES, NUMBERS), 10_000),
)


@settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.data_too_large],
)
@given(DRIVES)
def test_every_bus_delivers_the_same(over_zenoh: Send, tmp_path: Path, message: Drive) -> None:
    assert over_zenoh(message) == over_memory(message) == over_replay(message, tmp_path)


def of_size(size: int) -> Drive:
    """Return a message with this number of bytes."""

    def worded(letters: int) -> Drive:
        return Drive(0, 0.0, 0.0, 0.0, 0, given_up=(ItemGivenUp(ROBOT, 0, 0, "x" * letters),))

    about = 60_000
    spare = size - len(encode(worded(about)))
    return worded(about + spare)


def test_the_limit_is_a_byte_wide_and_holds_on_every_bus(over_zenoh: Send, tmp_path: Path) -> None:
    most, over = of_size(MESSAGE_LIMIT), of_size(MESSAGE_LIMIT + 1)
    assert over_zenoh(most) == over_memory(most) == over_replay(most, tmp_path) == encode(most).hex()
    said = f"step 0: Drive on {KEY} has 65001 bytes; the limit is 65000"
    assert over_zenoh(over) == over_memory(over) == over_replay(over, tmp_path) == said


def test_value_of_wrong_type_is_named_by_its_path() -> None:
    report = VisitReport("r1", np.int64(3), 5)  # type: ignore[arg-type]
    assert over_memory(Drive(7, 0.0, 0.0, 0.0, 0, reports=(report,))) == (
        f"step 7: Drive on {KEY} has np.int64(3) of type numpy.int64 in reports[0].number; it must be a "
        "plain value (Encoding objects of type numpy.int64 is unsupported)"
    )
