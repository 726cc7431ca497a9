"""The laboratory without clock and lines: its time, its determinism, its faults."""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from actors.instant import START, Instant
from actors.orders import Obstacle, StartJam
from actors.runtime.errors import AcrcError
from actors.world.physics import SUBSTEP
from actors.world.uncertainty import Uncertainty
from actors.world.world_setup import TimedOrder
from firmware_bridge.beeclick.wire import SendPacket, Synchronise
from firmware_bridge.beeclick.wire import encode_command as encode_for_board
from firmware_bridge.device_lines import BASE, DEVICES, RADIO, RANGE, Jack, Lines
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.motion import base_control
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.kobuki.wire import encode_command, encode_frame
from firmware_bridge.laboratory.faults import Bench
from firmware_bridge.laboratory.laboratory import Laboratory
from firmware_bridge.range_sensors.rplidar import LidarRequest
from tests.laboratory.hosts import setup

FAST = encode_frame(encode_command(base_control(0.4, 0.3)))


USUAL = Uncertainty()


class Wire:
    """Keeps what has gone out."""

    def __init__(self) -> None:
        self.bytes: dict[Jack, bytes] = defaultdict(bytes)

    def __call__(self, jack: Jack, data: bytes) -> None:
        self.bytes[jack] += data


def driven(round_ms: int, dose: Uncertainty = USUAL) -> tuple[Laboratory, Wire]:
    """Two seconds in which r1 was told once to drive, and its lidar to scan, in rounds of that length."""
    room = setup(2, "kobuki")
    world = msgspec.structs.replace(room.world, uncertainty=dose)
    laboratory, wire = Laboratory(msgspec.structs.replace(room, world=world)), Wire()
    laboratory.take(Jack("r1", BASE), START, FAST)
    laboratory.take(Jack("r1", RANGE), START, LidarRequest.SCAN.bytes)
    for robot in ("r1", "r2"):
        packets = b"".join(encode_for_board(SendPacket(number, bytes(118))) for number in range(4))
        laboratory.take(Jack(robot, RADIO), START, b"\xff" + encode_for_board(Synchronise()) + packets)
    for at in range(0, 2001, round_ms):
        laboratory.advance(Instant(1000 * at), wire)
    return laboratory, wire


def test_what_happens_does_not_depend_on_how_often_one_looks() -> None:
    (often, by_often), (seldom, by_seldom) = driven(1), driven(40)
    assert often.now == seldom.now == Instant(2_000_000)
    assert often.pose("r1") == seldom.pose("r1")
    assert by_often.bytes == by_seldom.bytes
    assert len(by_often.bytes[Jack("r1", RANGE)]) == 7 + 5 * 3960
    assert often.air.counters() == seldom.air.counters()
    assert often.air.counters()["frames_sent"] == 8


def echoes(wire: Wire) -> float:
    """Share of the samples of r1's lidar with a distance; each has 5 bytes, after a descriptor of 7."""
    samples = np.frombuffer(wire.bytes[Jack("r1", RANGE)][7:], np.uint8).reshape(-1, 5)
    return float(np.mean(samples[:, 3:].any(axis=1)))


def test_lidars_and_bases_know_of_the_doses() -> None:
    (_, usual), (_, glass), (_, drift) = (
        driven(40, dose) for dose in (USUAL, Uncertainty(glass=1.0), Uncertainty(drift=50.0))
    )
    assert echoes(usual) > 0.9 and 0 < echoes(glass) < 0.6  # of r2, and of the map's edge
    base, lidar = Jack("r1", BASE), Jack("r1", RANGE)
    assert usual.bytes[base] == glass.bytes[base] != drift.bytes[base]
    assert usual.bytes[lidar] == drift.bytes[lidar] != glass.bytes[lidar]


def test_time_goes_in_whole_sub_steps_and_boards_live_through_the_rest() -> None:
    laboratory = Laboratory(setup(1))
    laboratory.advance(Instant(SUBSTEP + 3000), Wire())
    assert laboratory.now == Instant(SUBSTEP)
    assert laboratory.instant == SUBSTEP + 3000
    assert laboratory.wake == Instant(1_370_000)  # the board's first temperature


def test_what_events_do_to_air_and_floor_is_done() -> None:
    room = setup(2)
    orders = (
        TimedOrder(100_000, Obstacle(13.0, 12.5, 0.2)),
        TimedOrder(150_000, StartJam(12.0, 12.5, 1.0, 50_000)),
    )
    world = msgspec.structs.replace(room.world, events=orders)
    laboratory = Laboratory(msgspec.structs.replace(room, world=world))
    ahead, seen = np.array([0.0]), []
    for at in (90_000, 110_000):
        laboratory.advance(Instant(at), Wire())
        seen.append(float(laboratory._sights.of(0)(ahead)[0]))
    assert seen == pytest.approx(
        [2.0 + 0.1 - 0.177, 1.0 + 0.1 - 0.2], abs=0.05
    )  # r2, then what stands before it
    for robot, at in (("r2", 160_000), ("r2", 260_000)):
        laboratory.advance(Instant(at), Wire())
        radio = laboratory.robots[robot].radio
        laboratory.air.transmit(radio, laboratory.instant, 0, b"hello")
        laboratory.advance(Instant(at + 40_000), Wire())
    told = laboratory.air.counters()
    assert (told["frames_sent"], told["copies_lost_disturbed"], told["copies_heard"]) == (2, 1, 1)


# --- faults ----------------------------------------------------------------------------------------------


@pytest.fixture
def laboratory() -> Laboratory:
    return Laboratory(setup(2))


@pytest.fixture
def lines(tmp_path: Path) -> Iterator[Lines]:
    jacks = [Jack(robot, device) for robot in ("r1", "r2") for device in DEVICES]
    with Lines(tmp_path, jacks, np.random.default_rng(1)) as lines:
        yield lines


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (
            "explode r1",
            "there is no 'explode'; it should be one of battery, darken, deafen, edge, gps, ",
        ),
        ("lift r3", "there is no robot 'r3'; it should be one of r1, r2"),
        ("scramble r1 base", "'scramble r1 base' should be 'scramble ROBOT base|radio|range SHARE'"),
        ("scramble r1 base nan", "'nan' is not a share; it should be a number from 0 to 1"),
        ("press r1 nose", "there is no 'nose' here; it should be one of bumper|left|centre|right|radio"),
        ("plug r1 base", "the base of r1 is plugged in already; unplug it first"),
    ],
)
def test_what_cannot_be_done_is_told(laboratory: Laboratory, lines: Lines, line: str, sentence: str) -> None:
    with pytest.raises(AcrcError) as caught:
        Bench(laboratory, lines).do(line)
    assert str(caught.value).startswith(sentence)


def stops(laboratory: Laboratory, driver: KobukiDriver, duration_ms: int = 500) -> set[HoldCause]:
    """Why r1 stands after so long, though its driver wants to drive."""
    jack, begun = Jack("r1", BASE), laboratory.now
    for at in range(begun, begun + 1000 * duration_ms, SUBSTEP):
        now, wire = Instant(at + SUBSTEP), Wire()
        laboratory.advance(now, wire)
        driver.take(now, wire.bytes[jack])
        driver.command(now, 0.2, 0.0)
        laboratory.take(jack, now, driver.due(now))
    return {stop.cause for stop in driver.allowed.stops}


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("press r1 bumper", HoldCause.BUMPER),
        ("lift r1", HoldCause.WHEEL_DROP),
        ("edge r1", HoldCause.CLIFF),
        ("silence r1 base", HoldCause.NO_FEEDBACK),
        ("strain r1 left", HoldCause.OVERCURRENT),
        ("battery r1 13", HoldCause.BATTERY),
    ],
)
def test_a_fault_stops_the_driver_and_healing_lets_it_go(
    laboratory: Laboratory, lines: Lines, fault: str, cause: HoldCause
) -> None:
    bench, driver = Bench(laboratory, lines), KobukiDriver(START)
    assert stops(laboratory, driver) == set()
    bench.do(fault)
    assert cause in stops(laboratory, driver)
    bench.do("heal r1")
    stops(laboratory, driver, 3000)
    driven_by_then = laboratory.travelled("r1")
    stops(laboratory, driver)
    assert laboratory.travelled("r1") > driven_by_then


def test_a_deaf_base_drives_on_and_a_lifted_one_does_not(laboratory: Laboratory, lines: Lines) -> None:
    bench, wire = Bench(laboratory, lines), Wire()
    laboratory.take(Jack("r1", BASE), START, FAST)
    laboratory.advance(Instant(500_000), wire)
    bench.do("deafen r1")
    laboratory.take(Jack("r1", BASE), START, encode_frame(encode_command(base_control(0.0, 0.0))))
    before = laboratory.travelled("r1")
    laboratory.advance(Instant(1_000_000), wire)
    assert laboratory.travelled("r1") - before == pytest.approx(0.2, abs=0.05)
    bench.do("lift r1")
    laboratory.advance(Instant(2_000_000), wire)
    before = laboratory.travelled("r1")
    laboratory.advance(Instant(2_500_000), wire)
    assert laboratory.travelled("r1") == before


def test_a_corrupted_line_is_clean_again_and_unread_bytes_are_counted(lines: Lines) -> None:
    jack, sent = Jack("r2", RANGE), bytes(range(256)) * 8
    lines.scramble(jack, 0.1)
    with lines.path(jack).open("rb", buffering=0) as host:
        lines.send(jack, sent)
        damaged = host.read(4096)
        lines.scramble(jack, 0.0)
        lines.send(jack, sent)
        assert host.read(4096) == sent
    assert damaged != sent
    assert len(damaged) == pytest.approx(len(sent), rel=0.05)
    for _ in range(100):
        lines.send(jack, bytes(4096))
    unread = lines.unread(jack)
    assert unread > 200_000
    lines.unplug(jack)
    lines.send(jack, bytes(4096))
    assert lines.read(jack) == b""
    lines.plug(jack)
    assert lines.unread(jack) == unread
