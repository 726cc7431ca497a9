"""The examples: radio contention, the convoy, and the courteous strategy."""

import re
import runpy
from dataclasses import replace

import pytest

from acrc_testbed.testing import LoggedNavigation
from actors.geometry import Point
from actors.instant import START, Instant, seconds
from actors.items import ItemKey
from actors.randomness import generator
from cleaning.adoption import AdoptedDestinationRemove
from cleaning.cleaner import Cleaner, State
from deeco.knowledge import role_view
from examples.contention import contend
from examples.convoy import drive
from examples.courteous import CourteousRobot, OfferingCleaner, PlaceHandover, RandomYielding
from tests.cleaning.fakes import (
    NOW,
    OPEN,
    FakeTaskMonitor,
    assignment,
    route,
)


def test_more_load_delivers_a_smaller_share() -> None:
    light, heavy = contend(0.05), contend(0.8)
    assert light[0] > 0.9 and 0.5 > heavy[0] > 0.1
    assert light[1] == 0.0 and 3.0 < light[2] < heavy[2]


ALONE = [60.0 + 2.0 * 120 - 9.0, 45.0, 95.0]
"""After two minutes without news, m: the leader drives at 10 m/s and the others at 8, which they reach from
rest at 2 m/s²; on the way there it loses 25 m and they 16."""


@pytest.mark.parametrize("seed", [0, 3])
def test_the_gaps_converge(seed: int) -> None:
    rows = list(drive(seed=seed))
    assert len(rows) == 12
    # In the last half minute, with a fifth of the frames lost: within 5 cm.
    assert rows[-4:] == [pytest.approx([20.0, 20.0, 20.0], abs=0.05)] * 4
    assert min(gap for row in rows for gap in row) > 19.9, "never nearer before"


@pytest.mark.parametrize("off", [{"loss": 1.0}, {"reach": 0.0}], ids=str)
def test_without_radio_they_do_not(off: dict[str, float]) -> None:
    last = list(drive(**off))[-1]  # type: ignore[arg-type]  # none of them is the seed
    assert last == pytest.approx(ALONE, abs=0.2)  # motion goes in steps of 0.1 s


def test_only_vehicles_within_radio_range_close_up() -> None:
    last = list(drive(reach=70.0))[-1]
    assert last[:2] == pytest.approx([20.0, 20.0], abs=0.05)
    assert last[2] > 95.0


def test_the_same_seed_gives_the_same_drive_and_another_one_does_not() -> None:
    assert list(drive(seed=3)) == list(drive(seed=3))
    assert list(drive(seed=3)) != list(drive(seed=4))


def robot(name: str, at: float, *xs: float) -> CourteousRobot:
    mine = route(*xs, owner=name)
    return CourteousRobot(id=name, position=Point(at, 0.0), route=mine, destination=mine[0] if mine else None)


def test_programs_print_their_tables(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_module("examples.convoy", run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 12 and lines[0].startswith("  10 s")
    assert lines[-1] == " 120 s     20.0 m     20.0 m     20.0 m"
    runpy.run_module("examples.contention", run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    form = r"load 0\.\d\d: +\d+\.\d% delivered, +\d+\.\d% no access, +\d+\.\d\d ms"
    assert len(lines) == 5 and all(re.fullmatch(form, line) for line in lines)


def test_it_reorders_the_queue() -> None:
    r1 = robot("r1", 0.0, 9.0, 2.0, -1.0).reorder()
    assert [one.index for one in r1.route] == [2, 1, 0]
    assert r1.offered == assignment(9.0) and r1.destination == assignment(9.0)
    assert robot("r1", 0.0, 9.0).reorder().offered is None


def test_it_pauses_and_resumes_the_robot() -> None:
    navigation, monitor = LoggedNavigation(), FakeTaskMonitor()
    r1 = robot("r1", 0.0, 5.0).drive(navigation, monitor, NOW)
    r1 = replace(r1, waits_until=Instant(NOW + seconds(2)))
    for later in (0, 1):
        r1 = r1.wait(navigation, Instant(NOW + seconds(later))).drive(navigation, monitor, NOW)
    assert navigation.commands[1:] == [("stop", None), ("stop", None)] and navigation.goal is None
    r1.wait(navigation, Instant(NOW + seconds(2))).drive(navigation, monitor, NOW)
    assert navigation.goals[-1] == Point(5.0, 0.0)


def test_a_blocked_robot_waits_or_drives_to_a_random_place() -> None:
    r1, r2 = (replace(robot(name, 0.0, 5.0), state=State.BLOCKED) for name in ("r1", "r2"))
    ensemble, chance = RandomYielding(1.5), generator(1, "behaviour", "r1", 0)
    assert ensemble.membership(role_view(r2, Cleaner), r1)  # type: ignore[arg-type]  # it is a Cleaner
    made = [ensemble.at_member(r2, r1, OPEN, chance, NOW) for _ in range(20)]
    assert {(one.waypoint is None, one.waits_until) for one in made} == {
        (False, None),
        (True, NOW + seconds(3)),
    }
    navigation = LoggedNavigation()
    aside = next(one for one in made if one.waypoint)
    aside.drive(navigation, FakeTaskMonitor(), NOW)
    assert navigation.goals == [aside.waypoint]


def test_it_hands_a_place_over_to_a_finished_robot() -> None:
    r1, r2 = robot("r1", 0.0, 9.0, 2.0).reorder(), robot("r2", 30.0)
    hand_over, remove = PlaceHandover(), AdoptedDestinationRemove(exchange=False)
    offering = role_view(r1, OfferingCleaner)
    assert isinstance(offering, OfferingCleaner) and hand_over.membership(offering, r2)
    r2 = hand_over.at_member(offering, r2, NOW)
    assert r2.destination == assignment(9.0, term=1) and r1.holds(ItemKey("r1", 0))
    assert not hand_over.membership(offering, r2), "it has one now"
    heard = role_view(r2, OfferingCleaner)
    assert isinstance(heard, OfferingCleaner) and remove.membership(heard, r1)
    left = remove.at_member(heard, r1, NOW)
    assert not left.holds(ItemKey("r1", 0)) and left.destination == assignment(2.0, 1)


def test_remaining_places_are_given_up_at_closing_time() -> None:
    monitor = FakeTaskMonitor()
    r1 = robot("r1", 0.0, 5.0, 9.0)
    assert r1.close(monitor, Instant(START + seconds(579))) == r1
    r1 = r1.close(monitor, Instant(START + seconds(580)))
    assert monitor.gone == [(ItemKey("r1", index), "it was closing time") for index in (0, 1)]
    assert (r1.route, r1.destination) == ((), None)
