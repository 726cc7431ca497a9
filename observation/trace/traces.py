"""The traces of robots of a run: those that are kept, and the others made, in sandboxes, and kept."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.robot.behaviour.foreign import Permit
from actors.runtime.recording.reading import report_damage
from observation.replay.run_recordings import all_recordings, run_of
from observation.replay.sandboxed_calls import Bounds, Call, CallOutcome, ask, check_trust
from observation.trace.kept import MOST_BYTES, TraceError, decode, inputs, joined, keep, kept, parts
from observation.trace.rows import Trace

BOUNDS: Final = Bounds(MOST_BYTES)


@dataclass(frozen=True)
class Traced:
    """What came of one process: parts of its trace, or why there are none."""

    actor: str
    parts: tuple[Trace, ...] = ()
    fault: str | None = None

    def whole(self) -> Trace:
        """All rows, with what was looked at closely of the first part. TraceError for a fault."""
        trace = joined(self.parts) if self.parts else None
        if trace is None or trace.fault is not None:
            raise TraceError(self.fault or (trace and trace.fault) or f"{self.actor}: has no trace")
        return trace


def traces(
    out: Path, actors: Sequence[str], *, permit: Permit, isolate: bool, bounds: Bounds = BOUNDS
) -> Iterator[Traced]:
    """The trace of each process, as it is there; those that are kept first.

    `isolate`: see `actors.runtime.isolation.sandbox`. Of code that the permit does not cover the fault says
    that it was not run. What was made by code that need not be the recorded one is not kept.
    """
    files, wanted = all_recordings(out), list[str]()
    for actor in actors:
        if actor in files:
            report_damage(files[actor])
        found = _kept(files, actor) if not permit.trust else None
        if found is None:
            wanted.append(actor)
        else:
            yield found
    came_of = {actor: inputs(files[actor]) for actor in wanted if actor in files}
    words = ("--file-mb", str(max(1, bounds.most_bytes // 1_000_000)))
    calls = [Call(actor, (actor,), words) for actor in wanted]
    for answer in ask(out, "observation.trace.program", calls, bounds, permit=permit, isolate=isolate):
        traced = _read(answer)
        if traced.parts and traced.parts[-1].fault is None and may_keep(out, traced.actor, permit):
            assert answer.data is not None
            keep(files[traced.actor], came_of[traced.actor], parts(answer.data))
        yield traced


def may_keep(out: Path, actor: str, permit: Permit) -> bool:
    """True if what made a trace is known to be the recorded code: this project's, or by its hashes."""
    known = run_of(all_recordings(out)[actor]).code is not None
    return not permit.trust and (known or check_trust(out, actor, permit) == ())


def _kept(files: dict[str, Path], actor: str) -> Traced | None:
    found = kept(files[actor]) if actor in files else None
    if not found:
        return None
    try:
        return Traced(actor, tuple(map(decode, found)))
    except TraceError:
        return None


def _read(answer: CallOutcome) -> Traced:
    if answer.data is None:
        return Traced(answer.name, fault=answer.fault)
    try:
        return Traced(answer.name, tuple(map(decode, parts(answer.data))))
    except TraceError as error:
        return Traced(answer.name, fault=f"{answer.name}: {error}")
