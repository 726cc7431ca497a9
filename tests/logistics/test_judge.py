"""Judge of the logistics task: loads, deadlines, chargers and false reports."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.instant import Instant
from actors.items import ItemKey
from actors.task.task import JudgeSetup, TaskError
from logistics.demand import LogisticsTable
from logistics.items import FacilityStatus, OrderConfirmation
from logistics.judge import LogisticsJudge
from tests.logistics.fakes import SITES, Answer, Bench, outage


def test_an_order_is_carried_and_confirmed() -> None:
    bench = Bench(orders=1)
    key, pickup, delivery = bench.order()
    ends = SITES.index(pickup), SITES.index(delivery)
    bench.put("r2", pickup.x + 0.4, pickup.y)
    bench.advance()
    assert bench.picks_up("r2", key) is None, "by any robot"
    assert bench.world.given[-1] == ("r2", OrderConfirmation(key.owner, key.number, *ends, False))
    bench.put("r2", delivery.x, delivery.y)
    bench.advance(10)
    assert not bench.judge.settled and bench.delivers("r2", key) is None
    assert bench.world.given[-1] == ("r2", OrderConfirmation(key.owner, key.number, *ends, True))
    (row,) = bench.rows()
    assert (row["state"], row["carrier"], row["delivered_s"]) == ("delivered", "r2", bench.now / 1e6)
    outcome = bench.outcome()
    assert bench.judge.settled and outcome.values["completion_s"] == bench.now / 1e6
    assert outcome.robots["r2"]["orders_delivered"] == 1 and outcome.values["reports_refused"] == 0
    assert {event.kind for event in bench.judge.take_changes()[1]} == {"picked up", "delivered"}


def test_false_reports_are_refused_and_counted() -> None:
    bench = Bench(orders=1)
    key, pickup, delivery = bench.order()
    bench.picks_up("r1", key)  # far away
    bench.put("r1", pickup.x + 0.6, pickup.y)
    bench.advance()
    bench.picks_up("r1", key)  # not near enough
    bench.put("r1", pickup.x, pickup.y)
    bench.world.speeds["r1"] = 0.2
    bench.advance()
    bench.picks_up("r1", key)  # not standing
    bench.world.speeds["r1"] = 0.0
    bench.delivers("r1", key)  # not picked up
    assert bench.outcome().values["reports_refused"] == 4 and bench.rows()[0]["state"] == "waiting"
    bench.picks_up("r1", key)
    bench.put("r2", pickup.x, pickup.y)
    bench.advance()
    bench.picks_up("r2", key)  # taken
    bench.put("r2", delivery.x, delivery.y)
    bench.advance()
    bench.delivers("r2", key)  # carried by another robot
    outcome = bench.outcome()
    assert (outcome.robots["r1"]["reports_refused"], outcome.robots["r2"]["reports_refused"]) == (4, 2)
    assert outcome.notes == ("6 reports were refused: ground truth did not confirm them.",)


def test_unknown_orders_and_chargers_are_errors() -> None:
    bench = Bench()
    assert bench.picks_up("r1", ItemKey("r1", 0)) == "reports order 0 of 'r1', which does not exist"
    assert bench.wants("r1", 7) == "wants charger 7, which does not exist"
    answer = Answer(route=(ItemKey("r2", 1),))
    wrong = bench.judge.take("r1", answer, 0, 100_000)
    assert wrong == "gives up r2/1 or has it in its route, which does not exist"
    assert bench.judge.give(Instant(0), "r1", ()) == "this task takes no further items"


def test_a_robot_carries_no_more_than_its_capacity() -> None:
    bench = Bench(robots=1)
    bench.advance(300)
    first, *others = [row for row in bench.rows() if row["pickup"] == 0]
    bench.put("r1", 0.0, 0.0)
    bench.advance()
    for row in (first, *others):
        bench.picks_up("r1", ItemKey("r1", row["order"]))
    assert len(others) > 2 and sum(row["state"] == "carried" for row in bench.rows()) == 1


def test_deadlines() -> None:
    bench = Bench(orders=1, deadline=(5.0, 6.0))
    key, pickup, delivery = bench.order()
    row = bench.rows()[0]
    assert 5.0 <= row["deadline_s"] - row["arrived_s"] <= 6.0
    bench.advance(70)
    values = bench.outcome().values
    assert values["orders_late"] == 1 and 0.9 < values["lateness_s"] < 2.1
    assert [event.kind for event in bench.judge.take_changes()[1]] == ["late"]
    bench.put("r1", pickup.x, pickup.y)
    bench.advance()
    bench.picks_up("r1", key)
    bench.put("r1", delivery.x, delivery.y)
    bench.advance()
    bench.delivers("r1", key)
    late = bench.outcome().values["lateness_s"]
    bench.advance(100)
    assert bench.outcome().values["lateness_s"] == late and bench.outcome().values["orders_delivered"] == 1


def test_a_charger_charges_one_robot_at_a_time() -> None:
    bench = Bench(power=20.0)
    for robot in bench.ids:
        bench.put(robot, 0.0, 5.2)
        bench.wants(robot)
    bench.advance(10)
    assert bench.world.charged == [("r1", 20.0)], "the first robot stays"
    values = bench.outcome().robots
    assert (values["r1"]["charging_s"], values["r1"]["queueing_s"]) == (1.0, 0.0)
    assert (values["r2"]["charging_s"], values["r2"]["queueing_s"]) == (0.0, 1.0)
    causes = {(event.robot, event.kind) for event in bench.judge.take_changes()[1]}
    assert causes == {("r1", "charging"), ("r2", "waiting for a charger")}
    bench.wants("r1", -1)
    bench.advance()
    assert bench.world.charged == [("r2", 20.0)]
    bench.put("r2", 3.0, 5.0)
    bench.advance()
    assert bench.world.charged == []


def test_a_failed_charger_and_a_closed_station_do_not_work_and_are_told_in_sight() -> None:
    outages = outage(1_000_000, 3_000_000, charger=0), outage(1_000_000, 3_000_000, station=0)
    bench = Bench(orders=1, outages=outages)
    bench.put("r1", 0.0, 5.0)
    bench.wants("r1")
    bench.advance(15)
    told = [item for robot, item in bench.world.given if isinstance(item, FacilityStatus)]
    assert bench.world.charged == [] and told == [FacilityStatus(True, 0, False)]
    bench.put("r2", 0.0, 2.9)
    bench.advance()
    new = [(robot, item) for robot, item in bench.world.given if isinstance(item, FacilityStatus)][1:]
    assert new == [("r2", FacilityStatus(False, 0, False)), ("r2", FacilityStatus(True, 0, False))]
    bench.put("r2", 30.0, 30.0)
    bench.advance(20)
    told = [item for robot, item in bench.world.given if isinstance(item, FacilityStatus)]
    assert bench.world.charged == [("r1", 30.0)] and told[3:] == [FacilityStatus(True, 0, True)]


def test_robots_that_ran_empty_are_counted_and_leave_their_charger() -> None:
    bench = Bench()
    bench.put("r1", 0.0, 5.0)
    bench.wants("r1")
    bench.world.charges |= {"r1": 0.0, "r2": 0.5}
    bench.advance(2)
    values = bench.outcome().values
    assert (values["robots_empty"], values["first_empty_s"], bench.world.charged) == (1, 0.1, [])


def test_a_restarted_robot_keeps_its_load_and_must_request_its_charger_again() -> None:
    bench = Bench(orders=1)
    key, pickup, delivery = bench.order()
    bench.put("r1", pickup.x, pickup.y)
    bench.advance()
    bench.picks_up("r1", key)
    bench.wants("r1")
    bench.judge.restart("r1")
    bench.put("r1", 0.0, 5.0)
    bench.advance()
    assert bench.rows()[0]["state"] == "carried" and bench.world.charged == []
    bench.put("r1", delivery.x, delivery.y)
    bench.advance()
    bench.delivers("r1", key)
    assert bench.rows()[0]["state"] == "delivered"


MOVES = st.lists(st.tuples(st.integers(0, 1), st.integers(0, 3), st.integers(0, 5)), max_size=60)


@settings(max_examples=50, deadline=None)
@given(MOVES, st.integers(1, 3))
def test_no_load_is_duplicated_or_delivered_twice(moves: list[tuple[int, int, int]], seed: int) -> None:
    bench = Bench(seed=seed, orders=5, capacity=2)
    bench.advance(120)
    keys = [ItemKey(row["owner"], row["order"]) for row in bench.rows()]
    delivered: list[ItemKey] = []
    for robot, action, which in moves:
        name, key = bench.ids[robot], keys[which % len(keys)]
        if action < 2:
            bench.put(name, *((SITES[action].x, SITES[action].y)))
            bench.advance()
        before = {(row["owner"], row["order"]): row for row in bench.rows()}
        (bench.picks_up if action == 2 else bench.delivers)(name, key)
        after = {(row["owner"], row["order"]): row for row in bench.rows()}
        if after != before and action != 2:
            delivered.append(key)
        carriers = [row["carrier"] for row in bench.rows() if row["state"] == "carried"]
        assert all(carriers.count(one) <= 2 for one in bench.ids)
    assert len(delivered) == len({*delivered})
    values = bench.outcome().values
    assert values["orders_delivered"] == len(delivered)
    assert sum(row["state"] == "delivered" for row in bench.rows()) == len(delivered)


def test_the_judge_is_a_function_of_its_calls() -> None:
    def played() -> tuple[object, object]:
        bench = Bench(charger_fails_every=5_000_000, station_closed_every=5_000_000, outage=2_000_000)
        bench.put("r1", 0.0, 4.0)
        bench.put("r2", 0.0, 2.5)
        bench.advance(300)
        return bench.outcome(), bench.world.given

    assert played() == played()


def test_robots_must_have_the_same_stations_and_a_simulated_world() -> None:
    bench = Bench()
    items = {"r1": SITES, "r2": SITES[:2]}
    table = LogisticsTable()
    with pytest.raises(TaskError, match="r2 has other stations or chargers than r1"):
        LogisticsJudge(JudgeSetup(robots=("r1", "r2"), items=items, settings=table, world=bench.world))
    with pytest.raises(TaskError, match="cannot run on real robots"):
        LogisticsJudge(JudgeSetup(robots=("r1",), items=items, settings=table))
