"""Replays one actor in a sandbox like a robot's: a recording names the code that it runs.

`python -m acrc_testbed.replay.replay_program --out DIR --actor NAME --answer FILE --own DIR`: the answer is
one JSON object.
"""

import os

if __name__ == "__main__":  # who imports this has an environment of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.replay import sandboxed
from acrc_testbed.replay.record_replay import Onlook, ReplayReport, replay_actor
from actors.runtime import prints
from actors.runtime.errors import AcrcError

_FILE_MB: Final = 64
"""Of the answer, and of what the code prints, which is held to less by `Prints`."""


class ReplayAnswer(msgspec.Struct, frozen=True):
    """What came of a replay: one of the two."""

    report: ReplayReport | None = None
    fault: str | None = None


def main(argv: Sequence[str]) -> int:
    """Replay, and write down what came of it; the exit code."""
    options = sandboxed.parser("acrc_testbed.replay.replay_program").parse_args(argv)
    with sandboxed.answering(options, _FILE_MB) as answer:
        answer.write(msgspec.json.encode(_replayed(options.out, options.actor)))
    return 0


def _replayed(out: Path, actor: str) -> ReplayAnswer:
    try:
        return ReplayAnswer(report=replay_actor(out, actor, Onlook(prints=partial(prints.on, sys.stdout))))
    except AcrcError as error:
        return ReplayAnswer(fault=str(error))
    except Exception as error:
        return ReplayAnswer(fault=sandboxed.bug(actor, error))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
