"""Every robot of a run looked into, each in its own process, as many at a time as there are processors."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.instant import Duration, milliseconds
from actors.robot.behaviour.foreign import Permit
from observation.inside.telemetry import MOST_BYTES, Inside, TelemetryError, decode
from observation.replay.shut_off_calls import Bounds, Call, CallOutcome, ask

PERIOD: Final = milliseconds(500)
"""Between two looks: as often as a person can follow."""


@dataclass(frozen=True)
class Glance:
    """What came of one actor: one of the two."""

    actor: str
    inside: Inside | None = None
    fault: str | None = None


def look_into_all(
    out: Path, actors: Sequence[str], *, permit: Permit, isolate: bool, period: Duration = PERIOD
) -> Iterator[Glance]:
    """Execute robots again from their recordings, and give each as it is done.

    Their code runs shut off, if `isolate` says so (`isolating.choose`). Of somebody's code, without `trust`,
    the glance says that it was not run.
    """
    calls = [Call(actor, (actor,), ("--period-us", str(period))) for actor in actors]
    bounds = Bounds(MOST_BYTES)
    for answer in ask(
        out, "observation.inside.inside_program", calls, bounds, permit=permit, isolate=isolate
    ):
        yield _glance(answer)


def _glance(answer: CallOutcome) -> Glance:
    if answer.data is None:
        return Glance(answer.name, fault=answer.fault)
    try:
        return Glance(answer.name, inside=decode(answer.data))
    except TelemetryError as error:
        return Glance(answer.name, fault=f"{answer.name}: could not be executed again: {error}")
