"""Adversaries: what each sends, what its peers make of it, and that no received bytes stop it."""

from collections.abc import Callable
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acrc_testbed.testing import LossyMedium, VirtualRobot, VirtualSwarm
from actors.geometry import Point, Pose
from actors.instant import Instant, milliseconds, seconds
from actors.messages import FRAME_DATA_LIMIT, MOST_FRAMES
from actors.robot.behaviour import Behaviour, ExchangeSettings, Start
from actors.robot.behaviour.adversary import adversary
from actors.robot.behaviour.node_host import node_of
from actors.robot_model import AdversaryKind
from cleaning.cleaner import Cleaner
from cleaning.strategies import auction, chapter
from deeco.fragments import Fragmenter
from deeco.link import Reception
from deeco.network import Replica
from deeco.packet import KnowledgePacket, Version, pack
from tests.cleaning.fakes import OPEN

KINDS: tuple[AdversaryKind, ...] = get_args(AdversaryKind)
ROBOTS = {"r1": [Point(0.0, 0.0), Point(9.0, 0.0)], "r2": [Point(0.0, 5.0)], "r3": [Point(0.0, -5.0)]}
LATER = Instant(seconds(100))
KEYED = ExchangeSettings(key="00112233445566778899aabbccddeeff")


def swarm(
    kind: AdversaryKind | None,
    strategy: Callable[[Start], Behaviour] = chapter.behaviour,
    medium: LossyMedium | None = None,
    **fields: Any,
) -> VirtualSwarm:
    """Return three honest robots and r4, an adversary without places; None: honest, too."""

    def behaviour(start: Start) -> Behaviour:
        made = strategy(start)
        return made if start.robot != "r4" or kind is None else adversary(kind, made, start)

    return VirtualSwarm(behaviour, OPEN, {**ROBOTS, "r4": [Point(5.0, 5.0)]}, medium, **fields)


def replica(made: VirtualSwarm, robot: str, of: str) -> Replica:
    node = node_of(made[robot].behaviour)
    assert node is not None
    found = node.replicas.get(of)
    assert found is not None
    return found


def position(made: VirtualSwarm, robot: str, of: str) -> Point | None:
    """Return the position of a robot in its replica at another; None: there is none."""
    role = replica(made, robot, of).role(Cleaner)
    return None if role is None else role.position


def counters(robot: VirtualRobot) -> dict[str, int]:
    node = node_of(robot.behaviour)
    assert node is not None
    return node.outcome()["counters"]


def sent_by(made: VirtualSwarm, robot: str) -> list[bytes]:
    return [frame.data for name, frame in made.medium.sent if name == robot]


def test_a_mute_robot_neither_sends_nor_receives() -> None:
    made = swarm("mute")
    made.advance(seconds(5))
    assert sent_by(made, "r4") == [] and counters(made["r4"])["packets"] == 0
    assert [position(made, "r1", of) for of in ("r2", "r3")] == [Point(0.0, 5.0), Point(0.0, -5.0)]


def test_a_silencer_makes_peers_ignore_one_another() -> None:
    made = swarm("silencer")
    made.advance(seconds(40))
    before = counters(made["r1"])["packets_old"]
    made["r2"].positioning.pose = Pose(3.0, 5.0, 0.0)
    made.advance(seconds(10))
    assert position(made, "r1", "r2") is None and replica(made, "r1", "r2").version.epoch == 2**63 - 1
    assert counters(made["r1"])["packets_old"] >= before + 18, "of two peers, each once per second"


def test_a_forger_publishes_one_robots_knowledge_as_anothers() -> None:
    made = swarm("forger")
    made.advance(seconds(5))
    assert position(made, "r1", "r3") == Point(0.0, 5.0), "of r2"
    assert position(made, "r1", "r2") == Point(0.0, 0.0), "of r1"
    assert position(made, "r2", "r1") == Point(0.0, -5.0), "of r3"


def test_a_forger_does_not_answer_its_own_packets_that_others_relay() -> None:
    made = swarm("forger", exchange=ExchangeSettings(relay=True, relay_delay=milliseconds(100)))
    made.advance(seconds(20))
    assert counters(made["r1"])["relayed"] > 10
    assert len(sent_by(made, "r4")) <= 3 * 21, "at most one for each publication of a peer"


def test_a_liar_publishes_under_its_own_id_only_as_often_as_others() -> None:
    made = swarm("liar")
    seen = set()
    for _ in range(12):
        made.advance(seconds(1))
        seen.add(position(made, "r1", "r4"))
    assert seen == {Point(0.0, 0.0), Point(0.0, 5.0), Point(0.0, -5.0)}, "of the others, never its own"
    assert position(made, "r1", "r2") == Point(0.0, 5.0)
    assert len(sent_by(made, "r4")) == len(sent_by(made, "r2")) == 12


@pytest.mark.parametrize("kind", ["forger", "silencer"])
def test_with_a_key_no_packet_of_a_robot_without_it_is_accepted(kind: AdversaryKind) -> None:
    made = swarm(kind, exchange=KEYED)
    made.advance(seconds(20))
    assert len(sent_by(made, "r4")) >= 20
    for robot, start in (("r1", Point(0.0, 0.0)), ("r2", Point(0.0, 5.0)), ("r3", Point(0.0, -5.0))):
        count = counters(made[robot])
        assert count["packets_forged"] >= 3 * 19 and count["packets_old"] == count["packets_junk"] == 0
        assert all(position(made, other, robot) == start for other in ("r1", "r2", "r3") if other != robot)


def test_a_liar_has_the_key() -> None:
    made = swarm("liar", exchange=KEYED)
    made.advance(seconds(20))
    assert counters(made["r1"])["packets_forged"] == 0
    assert position(made, "r1", "r4") in {Point(0.0, 0.0), Point(0.0, 5.0), Point(0.0, -5.0)}


@pytest.mark.parametrize(("kind", "kept"), [("mute", 1), ("liar", 0)])
def test_robots_leave_their_places_to_a_liar_that_claims_them(kind: AdversaryKind, kept: int) -> None:
    made = swarm(kind, auction.behaviour)
    made.advance(seconds(12))
    assert sum(len(made[robot].route) for robot in ("r1", "r2", "r3")) == kept


def test_a_replayer_sends_received_frames_unchanged_after_ten_seconds() -> None:
    made = swarm("replayer")
    made.advance(seconds(30))
    heard = [frame.data for name, frame in made.medium.sent if name != "r4" and frame.instant < seconds(19)]
    sent = sent_by(made, "r4")
    assert len(sent) > 50 and sent[: len(heard)] == heard
    accepted = [counters(made[robot]) for robot in ("r1", "r2", "r3")]
    assert all(one["packets_old"] + one["packets_own"] >= len(heard) for one in accepted), "none is new"


def test_a_replayer_makes_old_knowledge_look_new_to_a_robot_out_of_reach() -> None:
    links = {("r1", "r4"), ("r4", "r3")}
    made = swarm("replayer", medium=LossyMedium(reach=lambda *pair: -60.0 if pair in links else None))
    made.advance(seconds(5))
    made["r1"].positioning.pose = Pose(3.0, 0.0, 0.0)
    made.advance(seconds(7))
    assert position(made, "r3", "r1") == Point(0.0, 0.0), "where it was ten seconds ago"
    assert made.now - replica(made, "r3", "r1").heard < seconds(2)


def test_a_flooder_always_has_as_many_frames_as_a_robot_may_send() -> None:
    made = swarm("flooder")
    made.advance(seconds(2))
    frames = [frame for name, frame in made.medium.sent if name == "r4"]
    assert len(frames) == 20 * MOST_FRAMES and {len(frame.data) for frame in frames} == {FRAME_DATA_LIMIT}
    assert len({frame.instant for frame in frames}) == len(frames), "spread over the step"
    assert counters(made["r1"])["junk_frames"] > 500
    assert position(made, "r1", "r2") == Point(0.0, 5.0)


@pytest.mark.parametrize("kind", KINDS)
def test_an_adversary_drives_and_works_like_a_mute_robot(kind: AdversaryKind) -> None:
    made = swarm(kind)
    robot = made["r4"]
    robot.start.generator.random()
    made.advance(seconds(10))
    alone = swarm("mute")
    alone.advance(seconds(10))
    assert robot.navigation.commands == alone["r4"].navigation.commands
    assert robot.reports == alone["r4"].reports and robot.route == alone["r4"].route


def packet(component: str, version: Version, size: int) -> bytes:
    return pack(KnowledgePacket(component, version, 0, ((1, tuple([0] * 60 + [b"x" * size] * 4)),)))


HOSTILE = st.one_of(
    st.binary(max_size=FRAME_DATA_LIMIT),
    st.builds(
        packet,
        st.sampled_from(["r1", "r2", "r4", "x" * 32]),
        st.builds(Version, st.sampled_from([0, 2**64 - 1]), st.sampled_from([0, 2**64 - 1])),
        st.integers(0, 225),
    ),
)


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(KINDS),
    st.lists(st.tuples(st.integers(1, 4), HOSTILE), min_size=1, max_size=8),
    st.sampled_from([ExchangeSettings(), KEYED]),
)
def test_no_received_bytes_stop_an_adversary(
    kind: AdversaryKind, received: list[tuple[int, bytes]], exchange: ExchangeSettings
) -> None:
    robot = swarm(kind, exchange=exchange)["r4"]
    for step, (sender, data) in enumerate(received * 2, start=1):
        frames = Fragmenter(sender, first=step).frames([data]) if data else [b""]
        now = Instant(milliseconds(100 * step))
        robot.advance(now, [Reception(Instant(now - 1), sender, frame) for frame in frames])
    robot.advance(LATER, [])
