"""Every robot of a run looked into, each in its own process, as many at a time as there are processors."""

import os
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.instant import Duration, milliseconds
from actors.runtime.errors import AcrcError
from deploy.inside.telemetry import MOST_BYTES, Inside, TelemetryError, decode
from deploy.processes.launch import Child, Launcher, Program, launcher
from deploy.replay.trusted_replay import check_trust
from deploy.run.foreign import folder_of
from deploy.run.isolating import choose, warn
from deploy.run.preflight import said

PERIOD: Final = milliseconds(500)
"""Between two looks: as often as a person can follow."""
_PROGRAM: Final = "deploy.inside.inside_program"
_SHOWN: Final = 300
"""Characters of what a process said before it failed."""


class InsideError(AcrcError):
    """A robot that could not be looked into."""


@dataclass(frozen=True)
class Glance:
    """What came of one actor: one of the two."""

    actor: str
    inside: Inside | None = None
    fault: str | None = None


def look_into_all(
    out: Path,
    actors: Sequence[str],
    *,
    trust: bool,
    isolate: bool | None = None,
    period: Duration = PERIOD,
) -> Iterator[Glance]:
    """Execute robots again from their recordings, and give each as it is done.

    Their code runs shut off, where the machine can and `isolate` lets it. Of somebody's code, without
    `trust`, the glance says that it was not run.
    """
    choice = choose(isolate)
    warn(choice.warning)
    with tempfile.TemporaryDirectory(prefix="acrc") as folder, launcher("forkserver") as launched:
        home = Path(folder).resolve()
        waiting, running = deque(actors), dict[str, Child]()
        while waiting or running:
            while waiting and len(running) < (os.cpu_count() or 1):
                actor = waiting.popleft()
                try:
                    words = told_words(out, actor, period, trust=trust, isolate=choice.isolate)
                    running[actor] = start(launched, home, _PROGRAM, actor, words)
                except AcrcError as error:
                    yield Glance(actor, fault=str(error))
            ended = [actor for actor, child in running.items() if child.exit_code is not None]
            for actor in ended:
                yield _glance(home, actor, running.pop(actor))
            if running and not ended:
                launched.wait(0.5)


def told_words(out: Path, actor: str, period: Duration, *, trust: bool, isolate: bool) -> tuple[str, ...]:
    """What the actor's process is told. Raises an AcrcError for code that must not run."""
    named = check_trust(out, actor, trust=trust)
    if named is None:
        raise InsideError(f"{actor}: is no robot")
    code = folder_of(*named)
    return (
        *("--out", str(out.resolve()), "--actor", actor, "--period-us", str(period)),
        *(() if code is None else ("--path", str(code))),
        *(("--isolate",) if isolate else ()),
    )


def start(launched: Launcher, home: Path, module: str, actor: str, words: tuple[str, ...]) -> Child:
    """Its process, in a folder of its own, where its `answer` will be."""
    stage = home / actor
    (stage / "own").mkdir(parents=True)
    argv = (*words, "--answer", str(stage / "answer"), "--own", str(stage / "own"))
    return launched.start(Program(actor, module, argv, stage / "inside.log", None))


def _glance(home: Path, actor: str, child: Child) -> Glance:
    """What the process left."""
    try:
        with (home / actor / "answer").open("rb") as file:
            data = file.read(MOST_BYTES)
        (home / actor / "answer").unlink()
        return Glance(actor, inside=decode(data))
    except (OSError, TelemetryError):
        return Glance(actor, fault=failed(child))


def failed(child: Child) -> str:
    """Why a process has left no answer, in a sentence."""
    last = " ".join(said(child.program).split())[-_SHOWN:]
    return f"{child.program.actor}: could not be executed again (exit code {child.exit_code}): {last}"
