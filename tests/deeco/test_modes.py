"""Modes: when transitions fire, which processes are active, invalid charts, drawings."""

import re
import sys
import textwrap
from dataclasses import replace
from enum import Enum
from itertools import pairwise
from types import FrameType
from typing import Any, Self

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deeco import (
    START,
    DefinitionError,
    Duration,
    ExecutionError,
    Instant,
    Knowledge,
    ModeChart,
    Transition,
    component,
    ensemble,
    milliseconds,
    on_change,
    periodic,
    role,
    seconds,
)
from deeco.explain.command import Subjects
from deeco.explain.description import component_text, field_table, mermaid_chart
from deeco.explain.knowledge_use import processes
from deeco.link import Reception
from deeco.local import Commit
from deeco.node import Node
from tests.deeco.refusals import refused


class Mode(Enum):
    SEARCH = "search"
    CHARGE = "charge"
    STOP = "stop"


class Charges:
    """A battery whose charge follows a sequence, one value per second; the last one remains."""

    def __init__(self, *values: float) -> None:
        self.values = values

    def at(self, now: Instant) -> float:
        return self.values[min(now // seconds(1), len(self.values) - 1)]


@role
class Searcher(Knowledge):
    mode: Mode = Mode.SEARCH


@component
class Robot(Searcher):
    charge: float = 1.0
    patience: float = 3.0
    done: str = ""

    def is_low(self) -> bool:
        return self.charge < 0.2

    def is_empty(self) -> bool:
        return self.charge <= 0

    def is_full(self) -> bool:
        return self.charge > 0.9

    def hold_time(self) -> Duration:
        return seconds(self.patience)

    def current_mode(self) -> Mode:
        return self.mode

    modes = ModeChart(
        Transition(Mode.SEARCH, Mode.STOP, when=is_empty),
        Transition(Mode.SEARCH, Mode.CHARGE, when=is_low, after=seconds(2)),
        Transition(Mode.CHARGE, Mode.SEARCH, when=is_full, after=hold_time),
        Transition(Mode.CHARGE, Mode.STOP, after=seconds(10)),
    )

    @periodic(every=seconds(1))
    def measure(self, charges: Charges, now: Instant) -> Self:
        return replace(self, charge=charges.at(now))

    @periodic(every=seconds(1), order=1, modes=(Mode.SEARCH,))
    def search(self) -> Self:
        return replace(self, done=self.done + "s")

    @on_change(current_mode, modes=(Mode.CHARGE, Mode.STOP))
    def enter(self) -> Self:
        return replace(self, done=self.done + self.mode.name[0])


def changes(node_of: Any, *charges: float, until: float, step: float = 1.0) -> list[tuple[float, str, str]]:
    """Return instant in seconds, cause and new mode of each transition of a robot."""
    commits: list[Commit] = []
    node = Node([node_of], ports={Charges: Charges(*charges)}, on_commit=commits.append)
    end = 0.0
    while end < until:
        end += step
        node.advance(Instant(seconds(end)))
    return [
        (one.instant / seconds(1), one.by, one.after.mode.name)  # type: ignore[attr-defined]
        for one in commits
        if one.after.mode is not one.before.mode  # type: ignore[attr-defined]
    ]


ROBOT = Robot(id="r")


def test_a_transition_without_time_fires_at_the_commit() -> None:
    assert changes(ROBOT, 1, 0, until=3) == [(1.0, "Robot.is_empty", "STOP")]


def test_a_guard_must_hold_in_the_source_mode_for_the_whole_time() -> None:
    assert changes(ROBOT, 1, 0.1, until=3) == [], "due at 3 s"
    assert changes(ROBOT, 1, 0.1, until=4) == [(3.0, "Robot.is_low", "CHARGE")]
    assert changes(ROBOT, 1, 0.1, 0.5, 0.1, until=7) == [(5.0, "Robot.is_low", "CHARGE")]
    again = replace(ROBOT, mode=Mode.CHARGE, charge=0.1, patience=0)
    assert changes(again, 0.1, 1, 0.1, until=5) == [
        (1.0, "Robot.is_full", "SEARCH"), (4.0, "Robot.is_low", "CHARGE"),
    ], "low since 2 s, in the mode since 1 s"  # fmt: skip


def test_a_due_transition_fires_before_the_processes_of_its_instant() -> None:
    made = Node([ROBOT], ports={Charges: Charges(1, 0.1)})
    made.advance(Instant(seconds(10)))
    assert made.knowledge("r").done == "sssC", "no search at 3 s"  # type: ignore[attr-defined]


def test_a_component_may_start_in_another_mode_and_a_time_may_depend_on_the_knowledge() -> None:
    for patience in (0, 0.5, 3):
        robot = replace(ROBOT, mode=Mode.CHARGE, patience=patience)
        assert changes(robot, 1, until=5) == [(patience, "Robot.is_full", "SEARCH")]


def test_a_transition_without_guard_is_a_timeout() -> None:
    robot = replace(ROBOT, mode=Mode.CHARGE, charge=0.5)
    assert changes(robot, 0.5, until=20) == [(10.0, "Robot.transition", "STOP")]


def test_of_two_due_transitions_the_first_in_the_chart_fires() -> None:
    assert changes(replace(ROBOT, charge=0.0), 0, until=5) == [(0.0, "Robot.is_empty", "STOP")]
    robot = replace(ROBOT, mode=Mode.CHARGE, patience=10)
    assert changes(robot, 1, until=11) == [(10.0, "Robot.is_full", "SEARCH")]

    @component
    class Reversed(Robot):
        modes = ModeChart(*reversed(Robot.modes.transitions))

    stopped = Reversed(id="r", mode=Mode.CHARGE, patience=10)
    assert changes(stopped, 1, until=11) == [(10.0, "Reversed.transition", "STOP")]


def test_an_overridden_guard_counts() -> None:
    @component
    class Careful(Robot):
        def is_low(self) -> bool:
            return self.charge < 0.6

    assert changes(Careful(id="r"), 0.5, until=3) == [(2.0, "Careful.is_low", "CHARGE")]


CHARGES = st.lists(st.sampled_from([0.1, 0.5, 1.0]), min_size=1, max_size=30)


def reference(charges: list[float], patience: int, until: int) -> list[tuple[float, str]]:
    """Return the transitions of a robot, by one evaluation per second before and after the measurement."""
    mode, since, charge = "SEARCH", 0, 1.0
    low, full = until, 0  # instants since which these guards hold
    made: list[tuple[float, str]] = []
    for now in range(until):
        for _ in range(2):
            low = min(low, now) if charge < 0.2 else until
            full = min(full, now) if charge > 0.9 else until
            target = ""
            if mode == "SEARCH" and now >= max(low, since) + 2:
                target = "CHARGE"
            elif mode == "CHARGE" and now >= max(full, since) + patience:
                target = "SEARCH"
            elif mode == "CHARGE" and now >= since + 10:
                target = "STOP"
            if target:
                mode, since = target, now
                made.append((float(now), target))
            charge = charges[min(now, len(charges) - 1)]
    return made


@given(CHARGES, st.integers(0, 3), st.sampled_from([0.25, 1.0, 7.0, 40.0]))
def test_transitions_do_not_flap_and_do_not_depend_on_the_steps(
    charges: list[float], patience: int, step: float
) -> None:
    found = changes(replace(ROBOT, patience=patience), *charges, until=40, step=step)
    known = reference(charges, patience, 40)
    assert [(instant, mode) for instant, _, mode in found if instant < 40] == known
    least = {"CHARGE": min(patience, 10), "SEARCH": 2}
    for (begin, _, mode), (end, *_) in pairwise(found):
        assert end - begin >= least[mode]


def test_times_continue_over_a_gap() -> None:
    node = Node([replace(ROBOT, charge=0.1)], ports={Charges: Charges(0.1)})
    node.advance(Instant(seconds(1)))
    node.skip(Instant(seconds(1.7)))
    node.skip(Instant(seconds(5.5)))
    node.advance(Instant(seconds(5.6)))
    assert node.knowledge("r").mode is Mode.CHARGE  # type: ignore[attr-defined]


@component
class Flickering(Searcher):
    ticks: int = 0

    def is_odd(self) -> bool:
        return self.ticks % 2 == 1

    modes = ModeChart(
        Transition(Mode.SEARCH, Mode.CHARGE, when=is_odd, after=seconds(3600)),
        Transition(Mode.SEARCH, Mode.STOP, after=seconds(7200)),
    )

    @periodic(every=milliseconds(10))
    def count(self) -> Self:
        return replace(self, ticks=self.ticks + 1)


def test_a_guard_that_changes_often_schedules_few_evaluations() -> None:
    node = Node([Flickering(id="f")])
    node.advance(Instant(seconds(60)))
    node.skip(Instant(seconds(10_000)))
    periodic = (10_000 - 60) * 100 + (10_000 - 60)  # `count`, and publications
    assert node.outcome()["counters"]["skipped"] - periodic <= 2


@component
class Deciding(Searcher):
    modes = ModeChart(
        Transition(Mode.SEARCH, Mode.CHARGE, after=seconds(9)),
        Transition(Mode.SEARCH, Mode.STOP, after=seconds(9)),
    )

    @periodic(every=seconds(1))
    def decide(self) -> Self:
        return replace(self, mode=Mode.STOP)


@ensemble(every=seconds(1))
class Command:
    def membership(self, coordinator: Searcher, member: Searcher) -> bool:
        return True

    def at_member(self, coordinator: Searcher, member: Flickering) -> Flickering:
        return replace(member, mode=coordinator.mode)


def test_only_transitions_change_the_mode() -> None:
    told = "at 0 s changed the mode; only transitions may do so"
    with refused(f"Deciding.decide of 'd' {told}", ExecutionError):
        Node([Deciding(id="d")]).advance(Instant(1))
    other = Robot(id="r", mode=Mode.CHARGE)
    node = Node([other, Flickering(id="f")], [Command()], ports={Charges: Charges(0.5)})
    told += "\nin ensemble Command of 'r' and 'f' at 0 s"
    with refused(f"Command.at_member of 'f' {told}", ExecutionError):
        node.advance(Instant(1))


def test_a_cycle_of_transitions_without_time_is_an_error() -> None:
    @component
    class Circle(Searcher):
        modes = ModeChart(
            Transition(Mode.SEARCH, Mode.CHARGE),
            Transition(Mode.CHARGE, Mode.STOP),
            Transition(Mode.STOP, Mode.SEARCH),
        )

    sentence = "at 0 s processes keep triggering each other: mode transitions → mode transitions"
    with refused(sentence, ExecutionError):
        Node([Circle(id="c")]).advance(Instant(1))


def test_a_peer_sees_the_mode_if_a_role_publishes_it() -> None:
    seen: list[Mode] = []

    @ensemble(every=seconds(1))
    class Watch:
        def membership(self, coordinator: Searcher, member: Searcher) -> bool:
            seen.append(coordinator.mode)
            return False

    sender = Node([replace(ROBOT, charge=0.0)], address=1, ports={Charges: Charges(0)})
    receiver = Node([Flickering(id="f")], [Watch()], address=2)
    for second in (1, 2):
        frames = sender.advance(Instant(seconds(second)))
        receiver.advance(Instant(seconds(second)), [Reception(one.instant, 1, one.data) for one in frames])
    assert Mode.STOP in seen


def test_components_without_modes_call_no_function_for_them() -> None:
    @component
    class Plain(Searcher):
        ticks: int = 0

        @periodic(every=seconds(1))
        def count(self) -> Self:
            return replace(self, ticks=self.ticks + 1)

    called: set[str] = set()

    def record(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            called.add(frame.f_code.co_qualname.rpartition(">.")[2])

    node = Node([Plain(id="p")])
    sys.setprofile(record)
    try:
        node.advance(Instant(seconds(3)))
        node.skip(Instant(seconds(4)))
    finally:
        sys.setprofile(None)
    assert "Plain.count" in called
    assert not [name for name in called if "mode" in name.lower() or "changes" in name or "enabled" in name]


PRELUDE = """
from enum import Enum
from typing import Self
from deeco import Knowledge, ModeChart, Transition, component, periodic, replace, role, seconds

class Mode(Enum):
    SEARCH = 1
    CHARGE = 2

class Other(Enum):
    SEARCH = 1

@role
class Searcher(Knowledge):
    charge: float = 1.0

    def is_low(self) -> bool:
        return self.charge < 0.2

@component
class Stranger(Searcher):
    def is_odd(self) -> bool:
        return False

@component
class Robot(Searcher):
"""
FIELD = "mode: Mode = Mode.SEARCH\n"
FORTH = "Transition(Mode.SEARCH, Mode.CHARGE, when=Searcher.is_low)"
PROCESS = "@periodic(every=seconds(1), modes=(%s,))\ndef search(self) -> Self: ...\n"
MODES = "[<Mode.SEARCH: 1>, <Mode.CHARGE: 2>]"
NEEDS = (
    "needs both modes = ModeChart(...) with transitions and a field with the initial mode, such as "
    "mode: Mode = Mode.SEARCH"
)
MISTAKES = {
    f"Robot.search {NEEDS}": FIELD + PROCESS % "Mode.SEARCH",
    f"Robot.modes {NEEDS}": f"modes = ModeChart({FORTH})",
    f"Robot.modes {NEEDS} ": f"mode = Mode.SEARCH\nmodes = ModeChart({FORTH})",
    f"Robot.modes {NEEDS}  ": f"mode: Mode\nmodes = ModeChart({FORTH})",
    f"Robot.modes: <Other.SEARCH: 1> is not a mode; use one of {MODES}": (
        f"{FIELD}modes = ModeChart({FORTH}, Transition(Mode.CHARGE, Other.SEARCH))"
    ),
    f"Robot.modes: 'charge' is not a mode; use one of {MODES}": (
        f"{FIELD}modes = ModeChart({FORTH}, Transition('charge', Mode.SEARCH))"
    ),
    f"Robot.search: <Other.SEARCH: 1> is not a mode; use one of {MODES}": (
        f"{FIELD}modes = ModeChart({FORTH})\n{PROCESS % 'Other.SEARCH'}"
    ),
    "Robot.modes: no transitions lead to [<Mode.CHARGE: 2>]; add some, or remove modes": (
        f"{FIELD}modes = ModeChart(Transition(Mode.CHARGE, Mode.SEARCH))"
    ),
    "Robot.modes: Mode.SEARCH → Mode.CHARGE uses Stranger.is_odd, "
    "which is not a method of Robot or its roles": (
        f"{FIELD}modes = ModeChart(Transition(Mode.SEARCH, Mode.CHARGE, when=Stranger.is_odd))"
    ),
    "Robot.modes: Mode.SEARCH → Mode.CHARGE uses Robot.is_late, which has parameters": (
        f"{FIELD}def is_late(self, now: float): ...\n"
        "modes = ModeChart(Transition(Mode.SEARCH, Mode.CHARGE, after=is_late))"
    ),
    "Transition Mode.SEARCH → Mode.CHARGE: after=2 is 2 µs; use 0 or at least 1000 µs. "
    "seconds(1) is one second": "Transition(Mode.SEARCH, Mode.CHARGE, after=2)",
}


@pytest.mark.parametrize("sentence", MISTAKES)
def test_invalid_modes_are_refused_at_the_definition(sentence: str) -> None:
    with refused(sentence.rstrip(), DefinitionError):
        exec(PRELUDE + textwrap.indent(MISTAKES[sentence], "    "), {})


def test_a_fact_of_on_change_has_no_parameters() -> None:
    with pytest.raises(DefinitionError, match=r"Late\.is_late, which has parameters\Z"):

        @component
        class Late(Searcher):
            def is_late(self, now: Instant) -> bool:
                return now > START

            @on_change(is_late)  # type: ignore[arg-type]  # the mistake
            def stop(self) -> Self:
                return self


def test_explain_describes_and_draws_modes() -> None:
    text = "\n".join(component_text(Robot, processes(Robot)))
    assert (
        "    starts in    SEARCH\n"
        "    transition   SEARCH → STOP when is_empty\n"
        "    transition   SEARCH → CHARGE when is_low after 2 s\n"
        "    transition   CHARGE → SEARCH when is_full after hold_time\n"
        "    transition   CHARGE → STOP after 10 s\n"
    ) in text
    assert "search, a process of the adapted layer, every 1 s, order 1, in SEARCH\n" in text
    assert "enter, a process of the adapted layer, on a change of current_mode, in CHARGE, in STOP\n" in text
    parts = Subjects().parts(Robot)
    table = {line.split()[0]: line.split()[1:] for line in field_table(Robot, parts) if line.strip()}
    assert table["mode"] == ["modes", "search,", "enter", "—"]
    assert table["charge"] == ["measure", "modes", "—"] and table["patience"] == ["—", "modes", "—"]
    lines = [line.strip() for line in mermaid_chart({Robot: parts})]
    assert 'Robot_mode_CHARGE -- "when is_full after hold_time" --> Robot_mode_SEARCH' in lines
    assert "Robot_modes_start((start)) --> Robot_mode_SEARCH" in lines
    nodes = [match[1] for line in lines if (match := re.match(r"(?:subgraph )?(\w+)[\[({]", line))]
    ends = [end for line in lines for end in re.findall(r"^(\w+) -- |--> (\w+)$", line)]
    assert {name for pair in ends for name in pair if name} <= {*nodes} and len(nodes) == len({*nodes})
