"""Explanations for who only asks: the robot's strategy runs in a program that is shut off, and not here.

What that program answers was written beside the strategy: nothing is believed of it but what the types say.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.robot.behaviour.foreign import Permit
from observation.explanation.explain import (
    DecisionRow,
    ExplainAnswer,
    Explanation,
    ExplanationError,
    Wish,
    decode,
    processes,
)
from observation.replay.shut_off_calls import Bounds, Call, CallOutcome, ask

_PROGRAM: Final = "observation.explanation.explain_program"
_FILE_MB: Final = 64
"""Of an answer; all decisions of ten minutes with their causes have less than one."""
BOUNDS: Final = Bounds(_FILE_MB * 1_000_000)


@dataclass(frozen=True)
class Reasons:
    """Why a robot decided what it did: one of the two."""

    robot: str
    explanations: tuple[Explanation, ...] = ()
    fault: str | None = None


def decisions(
    out: Path, robot: str, *, permit: Permit, isolate: bool, bounds: Bounds = BOUNDS
) -> tuple[DecisionRow, ...]:
    """All decisions of a robot, those of its later processes behind. Raises ExplanationError."""
    return _one(out, _call(out, robot), permit, isolate, bounds).decisions


def explained(
    out: Path, asked: Wish, *, permit: Permit, isolate: bool, bounds: Bounds = BOUNDS
) -> tuple[Explanation, ...]:
    """Every decision that the robot made at an instant, or the one before it. Raises ExplanationError."""
    call = _call(out, asked.robot, "--at", repr(asked.at_s))
    return _one(out, call, permit, isolate, bounds).explanations


def all_reasons(
    out: Path, robots: Sequence[str], *, permit: Permit, isolate: bool, bounds: Bounds = BOUNDS
) -> Iterator[Reasons]:
    """Every decision of several robots explained, each robot as it is done."""
    calls = [_call(out, robot, "--every") for robot in robots]
    for answer in ask(out, _PROGRAM, calls, bounds, permit=permit, isolate=isolate):
        try:
            yield Reasons(answer.name, _read(answer).explanations)
        except ExplanationError as error:
            yield Reasons(answer.name, fault=str(error))


def _call(out: Path, robot: str, *words: str) -> Call:
    return Call(robot, processes(out, robot), (*words, "--file-mb", str(_FILE_MB)))


def _one(out: Path, call: Call, permit: Permit, isolate: bool, bounds: Bounds) -> ExplainAnswer:
    (answer,) = ask(out, _PROGRAM, [call], bounds, permit=permit, isolate=isolate)
    return _read(answer)


def _read(answer: CallOutcome) -> ExplainAnswer:
    if answer.data is None:
        raise ExplanationError(answer.fault or f"{answer.name}: nothing was answered")
    return decode(answer.name, answer.data)
