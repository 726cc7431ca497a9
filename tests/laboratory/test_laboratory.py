"""The laboratory in virtual time: real drivers on emulated devices, and what truly happens beside it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import NO_ECHO_MM, Heard, Scan, Sent
from actors.robot_model import load_model
from actors.world.body import Bodies
from actors.world.setup import RobotSetup, WorldSetup
from firmware_bridge.beeclick.events import Event
from firmware_bridge.beeclick.link import Link
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.laboratory.laboratory import DEVICES, Laboratory
from firmware_bridge.laboratory.setup import LaboratorySetup
from firmware_bridge.range_sensors.rplidar import Rplidar

CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"
STARTS = {"r1": (8.0, 12.5, 0.0), "r2": (12.0, 12.5, 0.0)}
SENSOR = load_model("turtlebot2", "chapter").sensor


def setup() -> LaboratorySetup:
    robots = tuple(
        RobotSetup(name, "turtlebot2", "chapter", "exact", start, ((9.0, 12.5),))
        for name, start in STARTS.items()
    )
    world = WorldSetup(str(CORRIDOR), 1, 100_000, 60_000_000, robots)
    return LaboratorySetup(world, (("r1", 1), ("r2", 2)), "beeclick")


class Bench:
    """A laboratory with a host for each device of each robot."""

    def __init__(self) -> None:
        self.laboratory = Laboratory(setup())
        begin = Instant(0)
        self.bases = {name: KobukiDriver(begin) for name in STARTS}
        self.lidars = {name: Rplidar(SENSOR, begin) for name in STARTS}
        self.links = {name: Link(BoardSettings(number)) for number, name in enumerate(STARTS, start=1)}
        self.events: dict[str, list[Event]] = {name: [] for name in STARTS}
        self.scans: list[Scan] = []
        for link in self.links.values():
            link.connect(begin)

    def run(self, duration: Duration, every: Callable[[Instant], None] = lambda now: None) -> None:
        until = self.laboratory.now + duration
        while self.laboratory.now < until:
            now = Instant(self.laboratory.now + milliseconds(10))
            every(now)
            for name in STARTS:
                self._to_devices(name, now)
            self.laboratory.advance(now, self._from_device)
            if scan := self.lidars["r1"].scan():
                self.scans.append(scan)

    def _to_devices(self, name: str, now: Instant) -> None:
        due = {"base": self.bases[name].due(now), "range": self.lidars[name].due(now)}
        due["radio"] = self.links[name].due(now)
        for device in DEVICES:
            if due[device]:
                self.laboratory.devices[name, device].take(now, due[device])

    def _from_device(self, name: str, device: str, data: bytes) -> None:
        now = self.laboratory.now
        match device:
            case "base":
                self.bases[name].take(now, data)
            case "range":
                self.lidars[name].take(now, data)
            case _:
                self.events[name] += self.links[name].take(now, data)


def test_a_base_that_is_driven_by_its_bytes_moves_its_body_and_knows_how_far() -> None:
    bench = Bench()
    bench.run(seconds(0.5))
    bench.run(seconds(4), lambda now: bench.bases["r1"].command(now, 0.3, 0.0))
    bench.run(seconds(2))
    odometry = bench.bases["r1"].odometry.read()
    assert odometry.vx == pytest.approx(0.0, abs=0.01)
    assert 0.8 < odometry.x < 1.3
    places = bench.laboratory.referee.outcomes({})
    assert places[0].reached_by == "r1", "its place is a metre ahead"
    assert places[0].reached_at is not None and 1_000_000 < places[0].reached_at < 4_500_000
    assert bench.laboratory.contacts == 0


def test_a_lidar_sees_what_the_simulated_sensor_sees() -> None:
    bench = Bench()
    bench.run(seconds(1.5))
    assert len(bench.scans) >= 3
    simulated = Bodies(setup().world).senses(0, 0, Instant(0), 0, False).scan
    assert simulated is not None
    seen, true = (np.frombuffer(one.ranges_mm, "<u2").astype(float) for one in (bench.scans[-1], simulated))
    both = (seen != NO_ECHO_MM) & (true != NO_ECHO_MM)
    assert both.mean() > 0.5
    assert np.median(np.abs(seen[both] - true[both])) <= 30, "mm"
    ahead = round((0.0 - SENSOR.first_angle) / SENSOR.increment) % SENSOR.rays
    assert seen[ahead] / 1000 == pytest.approx(4.0 - 0.177, abs=0.15), "the other robot"


def test_boards_hear_one_another_where_their_robots_are() -> None:
    bench = Bench()
    bench.run(seconds(0.5))
    bench.links["r1"].send(bench.laboratory.now, 5, b"knowledge")
    bench.run(seconds(0.2))
    assert [event.tag for event in bench.events["r1"] if isinstance(event, Sent)] == [5]
    (heard,) = [event for event in bench.events["r2"] if isinstance(event, Heard)]
    assert (heard.sender, heard.data) == (1, b"knowledge")
    counters = bench.laboratory.boards
    assert counters["r1"]["transmitted"] == counters["r2"]["heard"] == 1


def test_two_that_meet_touch_and_their_bumpers_say_so() -> None:
    bench = Bench()
    bench.run(seconds(0.5))

    def towards(now: Instant) -> None:
        bench.bases["r1"].command(now, 0.4, 0.0)

    bench.run(seconds(12), towards)
    assert bench.laboratory.contacts == 1
    assert bench.bases["r1"].allowed.stops and bench.bases["r1"].pressed() == 2
    assert bench.bases["r1"].odometry.read().x == pytest.approx(4.0 - 2 * 0.177, abs=0.05)
