"""Packets of cleaning robots, nodes that exchange destinations, and docs/authors.md."""

import re
import sys
from dataclasses import fields, replace
from pathlib import Path

import pytest

from acrc_testbed.testing import LossyMedium, VirtualSwarm
from actors import robot as robots
from actors.geometry import Point
from actors.installation.repository import REPOSITORY
from actors.items import REASON_LIMIT, ItemGivenUp, ItemKey
from actors.messages import FRAME_DATA_LIMIT, OutgoingFrame
from actors.robot.behaviour import (
    BatteryMeter,
    Behaviour,
    Decision,
    Door,
    ExchangeSettings,
    FloorPlan,
    Goal,
    Navigation,
    Plan,
    Positioning,
    Start,
    TaskMonitor,
    View,
    host,
)
from actors.robot.behaviour.loading import BehaviourError
from actors.robot.behaviour.node_host import node_of
from actors.robot.behaviour.ports import AbortReason, GoalOrder, GoalPhase, GoalStatus
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters
from cleaning.place import RESTART_TERM, Assignment, Takeover, VisitReport, assignments
from cleaning.robot import CleaningRobot
from cleaning.strategies.chapter import behaviour
from deeco import START, in_seconds, seconds
from deeco.aes_ccm import AesCcmAuthenticator
from deeco.component import PeriodicTrigger, processes_of
from deeco.fragments import CHECKSUM, HEADER, Fragmenter, Reassembly
from deeco.packet import KnowledgePacket, Version, pack, verified_packet
from deeco.schema import RoleRegistry
from tests.cleaning.fakes import (
    OPEN,
)
from tests.recorded_runs import record


def test_two_robots_head_on_turn_around_and_exchange_destinations() -> None:
    west, east = Point(-5.0, 0.0), Point(5.0, 0.0)
    swarm = VirtualSwarm(behaviour, OPEN, {"r1": [Point(0.0, 0.0), east], "r2": [Point(1.0, 0.0), west]})
    exchanged = ((ItemKey("r2", 0),), (ItemKey("r1", 0),))
    swarm.advance_until(lambda: (swarm["r1"].route, swarm["r2"].route) == exchanged, timeout=seconds(13))
    assert swarm["r1"].navigation.goals == [east, west] and swarm["r2"].navigation.goals == [west, east]


def chapter_beside_a_ghost(start: Start) -> Behaviour:
    """Return strategy `chapter`; r2 is blocked from the start and does not adapt."""
    if start.robot == "r1":
        return behaviour(start)
    ghost = CleaningRobot(id="r2", position=start.pose.point, state=State.BLOCKED, route=assignments(start))
    return host(start, ghost)


@pytest.mark.parametrize(("loss", "owner"), [(0.0, "r2"), (1.0, "r1")])
def test_old_replicas_take_no_part_in_adoptions(loss: float, owner: str) -> None:
    """In the released code a robot that disappeared counts as blocked forever."""
    places = {"r1": [Point(0.0, 0.0), Point(5.0, 0.0)], "r2": [Point(1.0, 0.0), Point(9.0, 0.0)]}
    swarm = VirtualSwarm(chapter_beside_a_ghost, OPEN, places)
    node = node_of(swarm["r1"].behaviour)
    assert node is not None
    swarm.advance_until(lambda: len(node.replicas) == 1, timeout=seconds(1.5))
    swarm.medium.loss = loss
    swarm.advance(seconds(6))
    knowledge = swarm["r1"].knowledge
    assert isinstance(knowledge, Cleaner) and knowledge.destination is not None
    assert knowledge.destination.key == ItemKey(owner, 0)
    assert [one.id for one in node.replicas] == ["r2"], "the node still has its replica"


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
    swarm = VirtualSwarm(behaviour, OPEN, {"r1": "a"}, epoch=epoch)
    swarm.advance(seconds(2))
    _, frame = swarm.medium.sent[0]
    assert isinstance(frame, OutgoingFrame)
    return frame


@pytest.mark.parametrize(("rssi_dbm", "relays"), [(-79.0, 0), (-81.0, 1)])
def test_relay_settings_of_the_scenario_reach_the_node(rssi_dbm: float, relays: int) -> None:
    exchange, medium = ExchangeSettings(relay=True, relay_below=-80.0), LossyMedium(reach=lambda *_: rssi_dbm)
    swarm = VirtualSwarm(behaviour, OPEN, {"r1": "a", "r2": "a"}, medium, exchange=exchange)
    swarm.advance(seconds(1))
    swarm["r1"].is_frozen = True
    swarm.advance(seconds(2))
    counters = swarm["r2"].behaviour.outcome()["deeco"].counters  # type: ignore[attr-defined]
    assert (counters["packets"], counters["relayed"]) == (1, relays)


def test_the_key_of_the_scenario_authenticates_packets_and_needs_a_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    exchange = ExchangeSettings(key="00112233445566778899AABBCCDDEEFF")
    swarm = VirtualSwarm(behaviour, OPEN, {"r1": "a", "r2": "a"}, exchange=exchange)
    swarm.advance(seconds(3))
    counters = swarm["r2"].behaviour.outcome()["deeco"].counters  # type: ignore[attr-defined]
    assert counters["packets"] >= 2 and counters["packets_forged"] == counters["packets_junk"] == 0
    (data,) = Reassembly().take(START, 1, swarm.medium.sent[0][1].data)
    tags = AesCcmAuthenticator(bytes.fromhex("00112233445566778899aabbccddeeff"))
    assert verified_packet(data, tags) == data[:-8]
    monkeypatch.setitem(sys.modules, "deeco.aes_ccm", None)  # as without cryptography
    with pytest.raises(
        BehaviourError, match=r"^deeco\.key requires the Python package cryptography; install "
    ):
        VirtualSwarm(behaviour, OPEN, {"r1": "a"}, exchange=exchange)


PAGE = (REPOSITORY / "docs" / "authors.md").read_text()


def said() -> set[str]:
    """Return every name in backticks outside of code blocks."""
    text = re.sub(r"^```.*?^```$", "", PAGE, flags=re.MULTILINE | re.DOTALL)
    return {word for quoted in re.findall(r"`([^`]+)`", text) for word in re.findall(r"\w+", quoted)}


@pytest.mark.parametrize("port", [Positioning, Navigation, BatteryMeter, TaskMonitor, FloorPlan, Plan, Door])
def test_every_name_of_a_port_is_on_the_page(port: type) -> None:
    names = {
        name for name in (*vars(port), *getattr(port, "__annotations__", ())) if not name.startswith("_")
    }
    assert names and names - said() == set()


def test_every_field_and_every_public_name_is_on_the_page() -> None:
    wanted = {one.name for kind in (Start, Decision) for one in fields(kind)} | {
        *ExchangeSettings.__struct_fields__
    }
    wanted |= {one for kind in (ItemKey, VisitReport, ItemGivenUp) for one in kind.__struct_fields__}
    wanted |= {"VisitReport", "ItemGivenUp", *View._fields, *Goal._fields, *robots.behaviour.__all__}
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
    assert result.task["places_done"] == result.task["places_claimed"] != 0
    assert result.task["places_lost"] == 0
