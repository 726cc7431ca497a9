"""A world and robots' answers for the judge of the logistics task."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from actors.instant import Duration, Instant
from actors.items import ItemGivenUp, ItemKey
from actors.task.task import JudgeSetup
from logistics.demand import LogisticsTable, OutageTable
from logistics.items import Charger, ChargingRequest, DeliveryReport, PickupReport, Station
from logistics.judge import LogisticsJudge

STEP = 100_000
SITES = (Station(0.0, 0.0), Station(10.0, 0.0), Charger(0.0, 5.0))


def outage(at: int, until: int, **which: int) -> OutageTable:
    """Return an outage of a station or charger between two instants, µs."""
    return OutageTable(at=Duration(at), until=Duration(until), **which)


@dataclass
class FakeWorld:
    """World whose robots stand where the test puts them."""

    speeds: dict[str, float] = field(default_factory=dict)
    charges: dict[str, float] = field(default_factory=dict)
    given: list[tuple[str, Any]] = field(default_factory=list)
    charged: list[tuple[str, float]] = field(default_factory=list)
    """Calls of `charge` in the last step."""

    def charge(self, robot: str, watts: float) -> None:
        self.charged.append((robot, watts))

    def battery(self, robot: str) -> float | None:
        return self.charges.get(robot)

    def speed(self, robot: str) -> float:
        return self.speeds.get(robot, 0.0)

    def give(self, robot: str, items: Sequence[Any]) -> None:
        self.given += [(robot, item) for item in items]


@dataclass(frozen=True)
class Answer:
    """Reports of one robot."""

    reports: tuple[Any, ...] = ()
    given_up: tuple[ItemGivenUp, ...] = ()
    route: tuple[ItemKey, ...] | None = None


class Bench:
    """A judge with robots that the test places; the first order arrives in the first second or so."""

    def __init__(self, robots: int = 2, seed: int = 1, duration_s: int = 600, **settings: Any) -> None:
        self.world = FakeWorld()
        self.ids = tuple(f"r{number}" for number in range(1, robots + 1))
        self.positions = np.full((robots, 2), 50.0)
        self.now = 0
        self.judge = LogisticsJudge(
            JudgeSetup(
                robots=self.ids,
                items=dict.fromkeys(self.ids, SITES),
                settings=LogisticsTable(**({"rate": 60.0} | settings)),
                seed=seed,
                duration_us=duration_s * 1_000_000,
                world=self.world,
            )
        )
        self.judge.watch(Instant(0), self.positions)

    def advance(self, steps: int = 1) -> None:
        """Advance by steps of 100 ms."""
        for _ in range(steps):
            self.now += STEP
            self.world.charged.clear()
            self.judge.watch(Instant(self.now), self.positions)

    def put(self, robot: str, x: float, y: float) -> None:
        """Move a robot; effective in the next step."""
        self.positions[self.ids.index(robot)] = (x, y)

    def send(self, robot: str, *reports: Any) -> str | None:
        """Let a robot report in the current step."""
        return self.judge.take(robot, Answer(reports), self.now, self.now + STEP)

    def picks_up(self, robot: str, key: ItemKey) -> str | None:
        return self.send(robot, PickupReport(key.owner, key.number, self.now))

    def delivers(self, robot: str, key: ItemKey) -> str | None:
        return self.send(robot, DeliveryReport(key.owner, key.number, self.now))

    def wants(self, robot: str, charger: int = 0) -> str | None:
        return self.send(robot, ChargingRequest(charger, self.now))

    def order(self) -> tuple[ItemKey, Any, Any]:
        """Advance until an order has arrived; return its key, and its two stations."""
        while not self.rows():
            self.advance()
        row = self.rows()[0]
        return ItemKey(row["owner"], row["order"]), SITES[row["pickup"]], SITES[row["delivery"]]

    def rows(self) -> list[Any]:
        """Return the table of orders."""
        return list(self.outcome().items)

    def outcome(self) -> Any:
        """Return the outcome so far."""
        return self.judge.outcome(self.ids, Instant(self.now))
