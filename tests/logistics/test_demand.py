"""Orders and outages drawn from the seed."""

from itertools import pairwise, permutations

import pytest

from actors.instant import seconds
from actors.runtime.errors import AcrcError
from actors.settings import decode
from logistics.demand import MOST_ORDERS, LogisticsTable, OutageEvent, arrivals, outage_events
from logistics.task import Logistics
from tests.logistics.fakes import outage

HOUR = 3600 * 1_000_000


def test_arrivals_are_a_poisson_process_of_the_rate() -> None:
    table = LogisticsTable(rate=4.0, deadline=(100.0, 200.0))
    found = [one for seed in range(30) for one in arrivals(table, 5, 3, seed, HOUR)]
    assert len(found) / 30 == pytest.approx(240, rel=0.03)
    orders = [one.order for one in found]
    assert {(one.pickup, one.delivery) for one in orders} == {*permutations(range(5), 2)}
    assert {one.robot for one in found} == {0, 1, 2}
    assert all(100e6 <= one.deadline - one.arrived <= 200e6 for one in orders)
    instants = [one.order.arrived for one in arrivals(table, 5, 3, 1, HOUR)]
    gaps = [b - a for a, b in pairwise(instants)]
    mean = sum(gaps) / len(gaps)
    deviation = (sum((gap - mean) ** 2 for gap in gaps) / len(gaps)) ** 0.5
    assert deviation == pytest.approx(mean, rel=0.15), "exponential gaps"


def test_orders_do_not_depend_on_the_duration() -> None:
    table = LogisticsTable()
    long, short = (arrivals(table, 4, 2, 3, end) for end in (HOUR, HOUR // 4))
    assert long[: len(short)] == short and len(short) < len(long)
    assert arrivals(LogisticsTable(orders=3), 4, 2, 3, HOUR) == long[:3]
    assert len(arrivals(LogisticsTable(rate=60.0), 4, 2, 3, 10 * HOUR)) == MOST_ORDERS
    assert arrivals(table, 4, 2, 4, HOUR) != long


def test_outages() -> None:
    listed = LogisticsTable(outages=(outage(5, 9, charger=1), outage(1, 7, station=2)))
    assert outage_events(listed, 3, 2, 1) == [
        OutageEvent(1, False, 2, 1),
        OutageEvent(5, True, 1, 1),
        OutageEvent(7, False, 2, -1),
        OutageEvent(9, True, 1, -1),
    ]
    drawn = LogisticsTable(charger_fails_every=seconds(600))
    events = outage_events(drawn, 3, 2, 1)
    assert {one.is_charger for one in events} == {True} and {one.number for one in events} == {0, 1}
    state = {0: 0, 1: 0}
    for one in events:
        state[one.number] += one.change
        assert state[one.number] in {0, 1}
    more = outage_events(drawn, 3, 3, 1)
    assert [one for one in more if one.number < 2] == events, "one stream per charger"


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"rate": 0}, "logistics.rate is 0, but must be a number above 0 and at most 60"),
        ({"deadline": [2, 1]}, "logistics.deadline is .*two times .* in s, at least 0"),
        ({"deadline": [-2, 1]}, "logistics.deadline is .*two times .* in s, at least 0"),
        ({"outages": [{"at": 1, "until": 2}]}, "must have either a station or a charger"),
        ({"outages": [{"station": 1, "at": 3, "until": 2}]}, "must have .* an `until` after `at`"),
        ({"stations": [[1, 2]]}, "logistics must have at least two stations"),
    ],
)
def test_wrong_settings(table: dict[str, object], sentence: str) -> None:
    with pytest.raises(AcrcError, match=sentence):
        decode(LogisticsTable, table, "logistics")


def test_outages_of_what_does_not_exist() -> None:
    table = LogisticsTable(outages=(outage(1, 2, charger=2),))
    fault = Logistics().settings_fault(table, ("r1",), (), ())
    assert fault == "logistics.outages[0].charger is 2, but must be below 2"
    some = Logistics().settings_fault(LogisticsTable(), ("r1", "r2"), ("r1",), ())
    assert some is not None and "all robots or none" in some
