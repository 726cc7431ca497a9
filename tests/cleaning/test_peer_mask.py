"""Robots that say where they are, and others that do not take them for walls."""

from dataclasses import replace

from actors.geometry import Point
from actors.instant import Instant, seconds
from cleaning.adaptive import AdaptiveCleaningRobot, HeardPeer
from cleaning.adoption import PeerMask
from cleaning.parameters import AdaptationParameters
from tests.cleaning.equipment import NOW, Base, adaptive

MASKING = AdaptationParameters(peer_mask=True)
NEAR, FAR = adaptive("r2", 3.0), adaptive("r3", 30.0)


def _masking() -> AdaptiveCleaningRobot:
    return replace(adaptive("r1", 0.0), parameters=MASKING)


def test_peers_within_the_distance_are_noted_the_newest_word_of_each() -> None:
    mask, robot = PeerMask(6.5), _masking()
    assert mask.membership(NEAR, robot) and not mask.membership(FAR, robot)
    robot = mask.at_member(NEAR, robot, NOW)
    later = replace(NEAR, position=Point(2.5, 0.0))
    robot = mask.at_member(later, mask.at_member(FAR, robot, NOW), Instant(NOW + seconds(1)))
    assert robot.peers == (
        HeardPeer("r3", FAR.position, NOW),
        HeardPeer("r2", Point(2.5, 0.0), Instant(NOW + seconds(1))),
    )


def test_the_localiser_is_told_and_old_word_is_forgotten() -> None:
    base = Base()
    robot = PeerMask(6.5).at_member(NEAR, _masking(), NOW)
    robot = robot.disregard_peers(base, Instant(NOW + seconds(3)))
    assert base.peers == [NEAR.position] and robot.peers
    robot = robot.disregard_peers(base, Instant(NOW + seconds(3.5)))
    assert base.peers == [] and robot.peers == ()


def test_who_does_not_mask_says_nothing() -> None:
    base = Base()
    adaptive("r1", 0.0).disregard_peers(base, NOW)
    assert base.peers is None
