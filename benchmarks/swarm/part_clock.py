"""CPU time by part of one thread: calls are wrapped for a while and then put back; and its budget."""

import inspect
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

Clock = Callable[[], int]
_PROBES: Final = 20_000


class Target(NamedTuple):
    """Something that is called, and the part that its time counts for."""

    owner: Any
    """A class or a module."""
    name: str
    """Of its attribute."""
    part: str


@dataclass
class Account:
    """What one part has used."""

    spent_ns: int = 0
    """CPU time in the part itself, without that in the parts which it calls."""
    calls: int = 0
    """How often it was entered."""
    inner: int = 0
    """How often it entered another part, or itself."""


@dataclass(frozen=True)
class Overhead:
    """What the clock itself costs per wrapped call, ns."""

    inside_ns: float
    """Counted for the part that is called."""
    outside_ns: float
    """Counted for the part that calls."""


class PartClock:
    """Accounts by actor and part. Every moment between `start` and `stop` is in exactly one of them."""

    def __init__(self, clock: Clock = time.thread_time_ns) -> None:
        self._clock = clock
        self._actor = ""
        self._own = Account()
        self._open = self._own
        self._since = 0
        self.accounts: dict[tuple[str, str], Account] = {}

    @property
    def own(self) -> Account:
        """What was in no part."""
        return self._own

    @property
    def total_ns(self) -> int:
        """Of all accounts."""
        return self._own.spent_ns + sum(account.spent_ns for account in self.accounts.values())

    def start(self) -> None:
        """Count from now on."""
        self._since = self._clock()

    def stop(self) -> None:
        """Count up to now."""
        self._open.spent_ns += self._clock() - self._since

    def wrap(
        self, call: Callable[..., Any], part: str, actor: Callable[[Any], str] | None = None
    ) -> Callable[..., Any]:
        """`call`, whose time goes to the part, of the actor that is at work.

        `actor` names the one that is at work in this call, from its first argument.
        """
        clock = self._clock
        accounts: dict[str, Account] = {}

        def timed(*args: Any, **named: Any) -> Any:
            before, who = self._open, self._actor
            if actor is not None:
                self._actor = actor(args[0])
            account = accounts.get(self._actor) or self._account(accounts, part)
            account.calls += 1
            before.inner += 1
            now = clock()
            before.spent_ns += now - self._since
            self._open, self._since = account, now
            try:
                return call(*args, **named)
            finally:
                now = clock()
                account.spent_ns += now - self._since
                self._open, self._since, self._actor = before, now, who

        return timed

    def _account(self, accounts: dict[str, Account], part: str) -> Account:
        account = self.accounts.setdefault((self._actor, part), Account())
        accounts[self._actor] = account
        return account


def calls_of(owner: type, part: str) -> list[Target]:
    """The public methods that a class itself defines, properties left out."""
    return [
        Target(owner, name, part)
        for name, value in vars(owner).items()
        if not name.startswith("_") and inspect.isfunction(value)
    ]


@contextmanager
def clocked(clock: PartClock, targets: Iterable[Target]) -> Iterator[None]:
    """Wrap all targets, each once, and put them back at the end."""
    before: dict[tuple[Any, str], Any] = {}
    try:
        for owner, name, part in targets:
            if (owner, name) not in before:
                before[owner, name] = vars(owner)[name]
                setattr(owner, name, clock.wrap(vars(owner)[name], part))
        yield
    finally:
        for (owner, name), value in before.items():
            setattr(owner, name, value)


def overhead(clock: Clock = time.thread_time_ns, probes: int = _PROBES, repeats: int = 5) -> Overhead:
    """What wrapping costs here and now: the least of several measurements of a call that does nothing."""
    bare = min(_probe(_Nothing(), PartClock(clock), probes)[0] for _ in range(repeats))
    figures = []
    for _ in range(repeats):
        parts = PartClock(clock)
        with clocked(parts, calls_of(_Nothing, "nothing")):
            outside, inside = _probe(_Nothing(), parts, probes)
        figures.append((inside, outside - bare))
    inside, outside = min(figures, key=sum)
    return Overhead(max(0.0, inside), max(0.0, outside))


class _Nothing:
    def nothing(self, one: int, other: int) -> None:
        """What a call costs."""


def _probe(thing: _Nothing, parts: PartClock, probes: int) -> tuple[float, float]:
    """ns per call: in the caller, its loop included, and in the part."""
    parts.start()
    for number in range(probes):
        thing.nothing(number, number)
    parts.stop()
    inside = sum(account.spent_ns for account in parts.accounts.values())
    return parts.own.spent_ns / probes, inside / probes


Key = tuple[str, str]
"""Actor and part."""
REST = "rest"


class BudgetLine(NamedTuple):
    """One part of one actor."""

    actor: str
    part: str
    ms: float
    """CPU ms per robot and simulated second."""


def budget(
    accounts: Mapping[Key, Account], total_ns: int, overhead: Overhead, robot_s: float
) -> tuple[list[BudgetLine], float]:
    """A line for each account, and REST, without what the clock cost; and the ms that the clock cost.

    The lines and the clock's cost add up to `total_ns`. `robot_s`: robots times simulated seconds.
    """
    per = 1e6 * robot_s
    calls = sum(account.calls for account in accounts.values())
    clock_ms = calls * (overhead.inside_ns + overhead.outside_ns) / per
    lines = [BudgetLine(*key, _net_ns(account, overhead) / per) for key, account in accounts.items()]
    rest_ms = total_ns / per - clock_ms - sum(line.ms for line in lines)
    return [*lines, BudgetLine("", REST, rest_ms)], clock_ms


def _net_ns(account: Account, overhead: Overhead) -> float:
    return account.spent_ns - account.calls * overhead.inside_ns - account.inner * overhead.outside_ns


def whole(lines: Sequence[BudgetLine]) -> float:
    """Of all lines, ms."""
    return sum(line.ms for line in lines)


def with_processes(lines: Sequence[BudgetLine], by_actor: Mapping[str, float], part: str) -> list[BudgetLine]:
    """The lines, and for each kind of process what it costs beyond its lines, so that all add up to it.

    `by_actor`: CPU ms per robot and simulated second of all processes of a kind. REST, which is no
    process's, is left out: what drives the actors there is not what drives them in processes.
    """
    own = [line for line in lines if line.actor in by_actor]
    beyond = [
        BudgetLine(actor, part, ms - whole([line for line in own if line.actor == actor]))
        for actor, ms in by_actor.items()
    ]
    return [*own, *beyond]
