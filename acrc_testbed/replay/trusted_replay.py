"""A recording replayed as the command line does: its code named first, then run in a sandbox."""

from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.replay.record_replay import ReplayReport, replay_actor
from acrc_testbed.replay.replay_program import ReplayAnswer
from acrc_testbed.replay.run_recordings import all_recordings
from acrc_testbed.replay.sandboxed_calls import Bounds, Call, CallOutcome, ask, check_trust
from actors.processes.robot_logs import show
from actors.robot.behaviour.foreign import Permit
from actors.robot.behaviour.modules import look_in
from actors.runtime.bus.replay_bus import ReplayError
from actors.runtime.errors import printable
from actors.runtime.isolation.sandbox import choose, warn
from actors.runtime.recording.reading import report_damage

BOUNDS: Final = Bounds(1 << 16)
"""A difference between two messages is one sentence, with both of them in it."""


def replay(
    out: Path, actor: str, *, permit: Permit, isolate: bool | None, bounds: Bounds = BOUNDS
) -> ReplayReport:
    """Replay one actor; a robot in a sandbox, where the machine has one and `isolate` lets it.

    World and radio run no code but this project's. Raises AcrcError for a robot whose recording names
    code that the permit does not cover; ReplayError at the first output that differs.
    """
    folders = check_trust(out, actor, permit)
    if folders is None:
        return replay_actor(out, actor)
    choice = choose(isolate)
    warn(choice.warning)
    if isolate is False:
        look_in(folders, any_content=permit.trust)
        return replay_actor(out, actor)  # in this process, where a debugger may be
    report_damage(all_recordings(out)[actor])
    calls = [Call(actor, (actor,))]
    (answer,) = ask(
        out, "acrc_testbed.replay.replay_program", calls, bounds, permit=permit, isolate=choice.isolate
    )
    show(answer.said)
    return _report(answer)


def _report(answer: CallOutcome) -> ReplayReport:
    """What the process has to say; ReplayError if that is a fault, or nothing."""
    if answer.data is None:
        raise ReplayError(answer.fault or f"{answer.name}: nothing was answered")
    try:
        told = msgspec.json.decode(answer.data, type=ReplayAnswer)
    except (ValueError, RecursionError):
        raise ReplayError(f"{answer.name}: what it answers makes no sense") from None
    if told.report is None:
        raise ReplayError(printable(told.fault or "") or f"{answer.name}: nothing was answered")
    return told.report
