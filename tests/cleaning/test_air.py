"""Packets of cleaning robots, nodes that exchange destinations, and docs/authors.md."""

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.random import Generator

from acrc_testbed.testing import LoggedNavigation, ScriptedPositioning, VirtualNetwork
from actors import robot as robots
from actors.geometry import Point, Pose
from actors.installation.repository import REPOSITORY
from actors.instant import Instant
from actors.messages import FRAME_DATA_LIMIT, FrameReceived, OutgoingFrame
from actors.randomness import generator
from actors.robot.behaviour import (
    BatteryMeter,
    Behaviour,
    Decision,
    Door,
    ExchangeSettings,
    FloorPlan,
    Goal,
    Navigation,
    PlaceMonitor,
    Plan,
    Positioning,
    Start,
    TaskList,
    View,
)
from actors.robot.behaviour.node_host import RobotTaskList
from actors.robot.behaviour.ports import AbortReason, GoalOrder, GoalPhase, GoalStatus
from actors.task.task import REASON_LIMIT, PlaceGivenUp, PlaceKey, PlaceReport
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters
from cleaning.place import RESTART_TERM, Assignment, Takeover
from cleaning.robot import CleaningRobot
from cleaning.strategies.chapter import behaviour
from deeco import Knowledge, in_seconds, seconds
from deeco.component import PeriodicTrigger, processes_of
from deeco.fragments import CHECKSUM, HEADER, Fragmenter
from deeco.node import Node
from deeco.packet import KnowledgePacket, Version, pack
from deeco.schema import RoleRegistry
from tests.cleaning.fakes import (
    OPEN,
    FakePlaceMonitor,
    adaptive,
    assignment,
)
from tests.recorded_runs import record

ENSEMBLES = (DestinationAdoption(1.5, 1, seconds(10)), AdoptedDestinationRemove(exchange=True))


def node(robot: CleaningRobot, navigation: LoggedNavigation, number: int) -> Node:
    ports = {
        Positioning: ScriptedPositioning(Pose(*robot.position, 0.0)),
        Navigation: navigation,
        TaskList: RobotTaskList((), 0),
        PlaceMonitor: FakePlaceMonitor(),
        FloorPlan: OPEN,
        Generator: generator(1, "behaviour", robot.id, 0),
    }
    ensembles = ENSEMBLES if isinstance(robot, AdaptiveCleaningRobot) else ()
    return Node([robot], ensembles, ports=ports, address=number)


def route_of(air: VirtualNetwork[Node], robot: str) -> list[PlaceKey]:
    knowledge: Knowledge = air[robot].knowledge(robot)
    assert isinstance(knowledge, CleaningRobot)
    return [assignment.key for assignment in knowledge.route]


def test_two_robots_head_on_turn_around_and_exchange_destinations() -> None:
    r1, r2 = adaptive("r1", 0.0, 5.0), adaptive("r2", 1.0, -5.0)
    navigation = {"r1": LoggedNavigation(), "r2": LoggedNavigation()}
    air = VirtualNetwork(
        {one.id: node(one, navigation[one.id], number) for number, one in enumerate((r1, r2), start=1)}
    )
    air.advance(seconds(9.5))
    assert route_of(air, "r1") == [PlaceKey("r2", 0)] and route_of(air, "r2") == [PlaceKey("r1", 0)]
    assert navigation["r1"].goals == [Point(5.0, 0.0), Point(-5.0, 0.0)]
    assert navigation["r2"].goals == [Point(-5.0, 0.0), Point(5.0, 0.0)]


def test_old_replicas_take_no_part_in_adoptions() -> None:
    """In the released code a robot that disappeared counts as blocked forever."""
    for audible, expected in ((True, PlaceKey("r2", 0)), (False, PlaceKey("r1", 0))):
        ghost = CleaningRobot(
            id="r2", position=Point(1.0, 0.0), state=State.BLOCKED, route=(assignment(9.0, owner="r2"),)
        )
        nodes = {
            "r1": node(adaptive("r1", 0.0, 5.0), LoggedNavigation(), 1),
            "r2": node(ghost, LoggedNavigation(), 2),
        }
        air = VirtualNetwork(nodes)
        air.advance(seconds(0.5))
        air.medium.loss = 0.0 if audible else 1.0
        air.advance(seconds(6))
        knowledge = nodes["r1"].knowledge("r1")
        assert isinstance(knowledge, Cleaner) and knowledge.destination is not None
        assert knowledge.destination.key == expected
        assert [one.id for one in nodes["r1"].replicas] == ["r2"], "the node still has its replica"


LONGEST = Assignment("r500", 999, Point(-123.456, 123.456), 2000)
"""Larger than in any scenario."""


def packet(robot: AdaptiveCleaningRobot) -> bytes:
    registry = RoleRegistry([Cleaner])
    return pack(KnowledgePacket(robot.id, Version(3, 100_000), 3, registry.pack(robot)))


def robot(adopted: int, destination: Assignment | None = LONGEST) -> AdaptiveCleaningRobot:
    takeovers = tuple(Takeover("r500", 999 - number, 2000) for number in range(adopted))
    made = AdaptiveCleaningRobot(id="r500", position=LONGEST.point, state=State.BLOCKED, adopted=takeovers)
    return replace(made, destination=destination, former=destination if adopted else None)


def test_with_nothing_adopted_one_frame() -> None:
    data = packet(robot(0))
    assert len(data) <= 100
    (frame,) = Fragmenter(1).frames([data])
    assert len(frame) == len(data) + HEADER.size + CHECKSUM.size <= FRAME_DATA_LIMIT


def test_with_ten_adopted_two_frames_and_three_after_restarts() -> None:
    assert AdaptationParameters().most_adopted == 10
    frames = Fragmenter(1).frames([packet(robot(10))])
    assert len(frames) == 2 and all(len(frame) <= FRAME_DATA_LIMIT for frame in frames)
    late = 3 * RESTART_TERM + 1
    takeovers = tuple(replace(takeover, term=late) for takeover in robot(10).adopted)
    assignment = replace(LONGEST, term=late)
    restarted = replace(robot(10, assignment), adopted=takeovers)
    assert len(Fragmenter(1).frames([packet(restarted)])) == 3
    assert len(Fragmenter(1).frames([packet(robot(0, assignment))])) == 1


def test_a_restarted_robot_does_not_reuse_packet_numbers() -> None:
    """Otherwise peers would combine fragments of two epochs."""
    frames = [_first_frame(epoch) for epoch in range(20)]
    assert len({frame.tag for frame in frames}) == 20 and max(frame.tag for frame in frames) < 2**63
    first = [HEADER.unpack_from(frame.data)[3] for frame in frames]
    assert first[0] == 0
    apart = [(b - a) % 2**16 for number, a in enumerate(first) for b in first[number + 1 :]]
    assert min(min(one, 2**16 - one) for one in apart) > 2_000


def _first_frame(epoch: int) -> OutgoingFrame:
    start = Start("r1", 1, epoch, Pose(1.0, 2.0, 0.0), (LONGEST.point,), np.random.default_rng(1))
    view = View(Instant(0), start.pose, False, None, ())
    return behaviour(start).advance(view, Instant(2_000_000)).frames[0]


@pytest.mark.parametrize(("rssi_dbm", "relays"), [(-79.0, 0), (-81.0, 1)])
def test_relay_settings_of_the_scenario_reach_the_node(rssi_dbm: float, relays: int) -> None:
    exchange = ExchangeSettings(relay=True, relay_below=-80.0)

    def hosted(robot: str, address: int) -> Behaviour:
        pose, places = Pose(1.0, 2.0, 0.0), (LONGEST.point,)
        generator = np.random.default_rng(address)
        return behaviour(Start(robot, address, 0, pose, places, generator, exchange=exchange))

    still, second = Pose(1.0, 2.0, 0.0), Instant(1_000_000)
    sent = hosted("r1", 1).advance(View(Instant(0), still, False, None, ()), second).frames
    heard = tuple(FrameReceived(second, 1, rssi_dbm, 200, frame.data) for frame in sent)
    listener = hosted("r2", 2)
    listener.advance(View(Instant(0), still, False, None, ()), second)
    listener.advance(View(second, still, False, None, heard), Instant(3_000_000))
    counters = listener.outcome()["deeco"].counters  # type: ignore[attr-defined]
    assert (counters["packets"], counters["relayed"]) == (1, relays)


PAGE = (REPOSITORY / "docs" / "authors.md").read_text()


def said() -> set[str]:
    """Return every name in backticks outside of code blocks."""
    text = re.sub(r"^```.*?^```$", "", PAGE, flags=re.MULTILINE | re.DOTALL)
    return {word for quoted in re.findall(r"`([^`]+)`", text) for word in re.findall(r"\w+", quoted)}


@pytest.mark.parametrize("port", [Positioning, Navigation, BatteryMeter, PlaceMonitor, FloorPlan, Plan, Door])
def test_every_name_of_a_port_is_on_the_page(port: type) -> None:
    names = {
        name for name in (*vars(port), *getattr(port, "__annotations__", ())) if not name.startswith("_")
    }
    assert names and names - said() == set()


def test_every_field_and_every_public_name_is_on_the_page() -> None:
    wanted = {one.name for kind in (Start, Decision) for one in fields(kind)} | {
        *ExchangeSettings.__struct_fields__
    }
    wanted |= {one for kind in (PlaceKey, PlaceReport, PlaceGivenUp) for one in kind.__struct_fields__}
    wanted |= {"PlaceReport", "PlaceGivenUp", *View._fields, *Goal._fields, *robots.behaviour.__all__}
    wanted |= {one.name for kind in (GoalStatus, AbortReason, GoalPhase) for one in kind}
    assert wanted - {GoalOrder.__name__, "BehaviourError"} - said() == set()


def test_documented_periods_are_those_of_the_processes() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (\d+) (ms|s) \| (\d) \|$", PAGE, re.MULTILINE)
    told = {
        name: (int(every) / (1000 if unit == "ms" else 1), int(order)) for name, every, unit, order in rows
    }
    true = {
        process.name: (in_seconds(process.schedule.every), process.schedule.order)
        for process in processes_of(AdaptiveCleaningRobot)
        if isinstance(process.schedule, PeriodicTrigger)
    }
    assert told == true


def test_a_behaviour_without_the_component_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert f"at most {REASON_LIMIT} characters" in PAGE
    text = re.findall(r"^```python\n(# my_study/in_order.py\n.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[0]
    (tmp_path / "authors_in_order.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    result = record(tmp_path / "out", robots=1, duration=45.0, strategy="authors_in_order:behaviour")
    assert result.places_done == result.places_claimed > 0
    assert result.places_lost == 0
