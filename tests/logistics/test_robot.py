"""Strategies of the logistics task in virtual time."""

from collections.abc import Callable
from typing import Any

import pytest

from acrc_testbed.testing import VirtualSwarm, floor
from actors.geometry import Pose
from actors.items import ItemKey
from actors.robot.behaviour import Behaviour, Start
from actors.runtime.errors import AcrcError
from deeco import seconds
from logistics.items import (
    Charger,
    ChargingRequest,
    DeliveryOrder,
    FacilityStatus,
    OrderConfirmation,
    PickupReport,
    Station,
)
from logistics.strategies.auction import behaviour as auction
from logistics.strategies.greedy import behaviour as greedy
from logistics.strategies.threshold import behaviour as threshold

FLOOR = floor("a....b....c....d....e")  # 1 m per character
SITES = [*(Station(*FLOOR[name]) for name in "ae"), *(Charger(*FLOOR[name]) for name in "bd")]
LATE = 10**9


def order(pickup: int, delivery: int) -> DeliveryOrder:
    return DeliveryOrder(pickup, delivery, 0, LATE)


def swarm(strategy: Callable[[Start], Behaviour], charges: str = "", **robots: list[Any]) -> VirtualSwarm:
    """Return robots with their start and items; `charges`: tenths of a percent by robot, such as "50 9"."""
    made = VirtualSwarm(
        strategy, FLOOR, {name: [here, *SITES, *rest] for name, (here, *rest) in robots.items()}
    )
    for name, charge in zip(robots, charges.split(), strict=False):
        made[name].battery = int(charge) / 1000
    return made


def test_the_nearest_load_is_next_and_a_refused_pickup_is_dropped() -> None:
    made = swarm(greedy, r1=["c", order(0, 1), order(1, 0)])
    robot = made["r1"]
    robot.positioning.pose = Pose(*FLOOR["d"], 0.0)
    made.advance(seconds(2))
    assert robot.navigation.goals == [FLOOR["e"]] and {*robot.route} == {ItemKey("r1", 4), ItemKey("r1", 5)}
    robot.reach_goal()
    made.advance(seconds(3))
    assert {*robot.reports} == {PickupReport("r1", 5, one.instant) for one in robot.reports}
    assert 4 <= len(robot.reports) <= 7
    made.advance(seconds(5))
    assert robot.navigation.goals == [FLOOR["e"], FLOOR["a"]] and robot.route == (ItemKey("r1", 4),)


def test_a_confirmed_load_is_delivered() -> None:
    made = swarm(greedy, r1=["a", order(0, 1), OrderConfirmation("r1", 4, 0, 1, False)])
    made.advance(seconds(2))
    assert made["r1"].navigation.goals == [FLOOR["e"]]
    made = swarm(greedy, r1=["a", order(0, 1), OrderConfirmation("r1", 4, 0, 1, True)])
    made.advance(seconds(2))
    assert made["r1"].navigation.goals == [] and made["r1"].route == ()


def test_a_restarted_robot_learns_what_it_carries() -> None:
    made = swarm(greedy, r1=["a", order(1, 0), OrderConfirmation("r2", 9, 0, 1, False)])
    made.advance(seconds(2))
    assert made["r1"].navigation.goals == [FLOOR["e"]] and ItemKey("r2", 9) in made["r1"].route


def test_closed_stations_and_failed_chargers_are_avoided() -> None:
    closed = FacilityStatus(False, 0, False)
    made = swarm(greedy, r1=["b", order(0, 1), order(1, 0), closed])
    made.advance(seconds(2))
    assert made["r1"].navigation.goals == [FLOOR["e"]]
    made = swarm(greedy, "9", r1=["b", order(0, 1), FacilityStatus(True, 0, False)])
    made.advance(seconds(2))
    assert made["r1"].navigation.goals == [FLOOR["d"]]
    assert [one.charger for one in made["r1"].reports] == [1]


def test_charging_ends_with_enough_charge() -> None:
    made = swarm(greedy, "9", r1=["a", order(0, 1)])
    robot = made["r1"]
    made.advance(seconds(1))
    robot.reach_goal()
    robot.battery = 0.07
    made.advance(seconds(1))
    assert [type(one) for one in robot.reports[:2]] == [ChargingRequest, ChargingRequest]
    assert [one.charger for one in robot.reports[:2]] == [0, -1]
    assert robot.navigation.goals == [FLOOR["b"], FLOOR["a"]]


@pytest.mark.parametrize(("strategy", "second"), [(greedy, "b"), (threshold, "d")])
def test_threshold_avoids_a_busy_charger(strategy: Callable[[Start], Behaviour], second: str) -> None:
    made = swarm(strategy, "9 9", r1=["b", order(0, 1)], r2=["a", order(0, 1)])
    made.advance(seconds(5))
    assert made["r2"].navigation.goals[-1] == FLOOR[second]


def test_the_auction_moves_an_order_to_the_robot_that_delivers_it_sooner() -> None:
    made = swarm(auction, "500 500", r1=["a", order(1, 0), order(0, 1)], r2=["e"])
    routes = (ItemKey("r1", 5),), (ItemKey("r1", 4),)
    made.advance_until(lambda: (made["r1"].route, made["r2"].route) == routes, timeout=seconds(5))
    assert made["r2"].reports[-1].owner == "r1" and made["r2"].reports[-1].number == 4


def test_the_auction_charges_first_if_an_order_would_take_too_much() -> None:
    made = swarm(auction, "12", r1=["a", order(0, 1)])
    made.advance(seconds(2))
    assert made["r1"].navigation.goals == [FLOOR["b"]]
    made = swarm(auction, "200", r1=["a", order(0, 1)])
    made.advance(seconds(2))
    assert isinstance(made["r1"].reports[-1], PickupReport)


def test_blocked_robots_give_way() -> None:
    made = swarm(auction, "500 500", r1=["c", order(1, 0)], r2=["c", order(0, 1)])
    for name, x in (("r1", -0.7), ("r2", 0.7)):
        made[name].positioning.pose = Pose(FLOOR["c"].x + x, FLOOR["c"].y, 0.0)
    made.advance(seconds(12))
    commands = [one for name in ("r1", "r2") for one, _ in made[name].navigation.commands]
    assert commands.count("back_out") == 1, "one of both"


def test_items_of_another_task_are_refused() -> None:
    with pytest.raises(AcrcError, match="items of another task than logistics"):
        VirtualSwarm(greedy, FLOOR, {"r1": "abc"})
