"""Explains decisions of one robot of a run, whose strategy runs in this process; `asking` has it shut off."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from actors.instant import in_seconds
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError, printable
from observation.explanation.air import Air
from observation.explanation.chain import Chain, Link, Second
from observation.explanation.retold import Made, Retold, retell
from observation.replay.run_recordings import recordings

_SAME_S: Final = 0.0501
"""Who asks for an instant means a decision that is no farther away: half a step."""


class ExplanationError(AcrcError):
    """Something that nobody can explain."""


class Wish(NamedTuple):
    """Of whom which decision is to be explained."""

    robot: str
    at_s: float | None
    """None: all are to be listed."""


class DecisionRow(msgspec.Struct, frozen=True):
    """A decision as it is listed."""

    at_s: Second
    words: str
    by: str
    """The process or exchange that changed the knowledge; "behaviour": what it told its robot."""


class Explanation(msgspec.Struct, frozen=True):
    """Why a robot decided something."""

    robot: str
    asked_s: Second
    at_s: Second
    """When the decision was made: the nearest before `asked_s`, unless `exact`."""
    exact: bool
    decision: str
    by: str
    chain: tuple[Link, ...]
    """The decision's own link first; causes stand below, one deeper than their effects."""


class ExplainAnswer(msgspec.Struct, frozen=True):
    """What is answered for one robot."""

    decisions: tuple[DecisionRow, ...] = ()
    explanations: tuple[Explanation, ...] = ()
    fault: str | None = None
    """Why there is none of both."""


def encode(answer: ExplainAnswer) -> bytes:
    """For the way out of the program that is shut off."""
    return msgspec.msgpack.encode(answer)


def decode(robot: str, data: bytes) -> ExplainAnswer:
    """What `encode` made of an answer for the robot. Raises ExplanationError for a fault and for all else."""
    try:
        answer = typed_json.decode(data, ExplainAnswer, form=msgspec.msgpack)
    except ValueError as error:
        raise ExplanationError(f"{robot}: what it answers makes no sense: {printable(str(error))}") from None
    if answer.fault is not None:
        raise ExplanationError(printable(answer.fault))
    if other := [one.robot for one in answer.explanations if one.robot != robot]:
        raise ExplanationError(f"{robot}: what it answers makes no sense: it is about {ascii(other[0])[:80]}")
    return answer


def wish(text: str) -> Wish:
    """`r2@157`: the decision of r2 at 157 s; `r2`: all of r2's. Raises ExplanationError."""
    robot, at, instant = text.partition("@")
    if not at:
        return Wish(robot, None)
    if not robot or not re.fullmatch(r"[0-9]+(\.[0-9]*)?", instant):
        raise ExplanationError(
            f"{text}: should be a robot and simulated seconds, such as r2@157, or r2 alone"
        )
    return Wish(robot, float(instant))


def listed(out: Path, robot: str) -> tuple[DecisionRow, ...]:
    """All decisions of a robot, those of its later processes behind."""
    rows: list[DecisionRow] = []
    for actor in processes(out, robot):
        rows += [_row(made) for made in retell(out, actor).decisions]
    return tuple(rows)


def explain(out: Path, asked: Wish) -> tuple[Explanation, ...]:
    """Every decision that the robot made at an instant, or the one before it.

    Executes the robot and the radio again. Raises ExplanationError if it had decided nothing by then.
    """
    assert asked.at_s is not None
    earliest: float | None = None
    for actor in reversed(processes(out, asked.robot)):
        retold = retell(out, actor)
        found = _chosen(retold.decisions, asked.at_s)
        if found:
            return tuple(_explained(out, retold, asked, found))
        if retold.decisions:
            earliest = in_seconds(retold.decisions[0].instant)
    then = "it never decides anything" if earliest is None else f"its first decision is at {earliest:g} s"
    raise ExplanationError(f"{asked.robot} had decided nothing by {asked.at_s:g} s; {then}")


def all_explained(out: Path, robot: str) -> Iterator[Explanation]:
    """Every decision of a robot, in the order of the instants; executes it and the radio once more."""
    for actor in processes(out, robot):
        retold = retell(out, actor)
        chain = Chain(retold, Air(out, retold.actor))
        for made in retold.decisions:
            yield _explanation(robot, in_seconds(made.instant), made, chain)


def _chosen(decisions: Sequence[Made], at_s: float) -> list[Made]:
    """Those at the instant, or of the last instant before it."""
    by_then = [made for made in decisions if in_seconds(made.instant) <= at_s + _SAME_S]
    if not by_then:
        return []
    near = [made for made in by_then if abs(in_seconds(made.instant) - at_s) <= _SAME_S]
    return near or [made for made in by_then if made.instant == by_then[-1].instant]


def _explained(out: Path, retold: Retold, asked: Wish, found: Sequence[Made]) -> Iterator[Explanation]:
    assert asked.at_s is not None
    chain = Chain(retold, Air(out, retold.actor))
    for made in found:
        yield _explanation(asked.robot, asked.at_s, made, chain)


def _explanation(robot: str, asked_s: float, made: Made, chain: Chain) -> Explanation:
    at_s = in_seconds(made.instant)
    exact = abs(at_s - asked_s) <= _SAME_S
    return Explanation(robot, asked_s, at_s, exact, made.words, made.by, tuple(chain.of(made)))


def processes(out: Path, robot: str) -> list[str]:
    """The processes of a robot, or the one that is named, in the order in which they were started.

    Raises ExplanationError where there is none.
    """
    files = recordings(out)
    found = [actor for actor, path in files.items() if path.parent.name == robot] or [
        actor for actor in files if actor == robot
    ]
    robots = sorted({path.parent.name for path in files.values()} - {"world", "radio"})
    if not found or robot in ("world", "radio"):
        raise ExplanationError(f"{robot}: is no robot of this run; there are {', '.join(robots)}")
    return found


def _row(made: Made) -> DecisionRow:
    return DecisionRow(in_seconds(made.instant), made.words, made.by)


def as_json(value: Any) -> str:
    """An explanation, or a list, for programs."""
    return msgspec.json.encode(value).decode()


def sentences(explanation: Explanation) -> Iterator[str]:
    """A line for each link."""
    robot, asked, at_s = explanation.robot, explanation.asked_s, explanation.at_s
    if not explanation.exact:
        yield f"{robot} decided nothing at {asked:g} s; before that it last did at {at_s:g} s:"
    for link in explanation.chain:
        yield f"{link.at_s:9.3f} s  {'   ' * link.depth}{link.says}"
