"""Replays one robot in a sandbox and writes its trace.

`python -m acrc_testbed.trace.program --out DIR --actor NAME --answer FILE --own DIR`: the answer is what
`coding.parts` reads. With `--follow` it grows with the recording of a run that goes on, and ends with it.
"""

import os

if __name__ == "__main__":  # who imports this has an environment of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from acrc_testbed.replay import sandboxed
from acrc_testbed.replay.record_replay import GrowingReplay, Onlook, made_again, replay_actor
from acrc_testbed.replay.run_recordings import recordings
from acrc_testbed.trace.perception import Collector
from acrc_testbed.trace.rows import Trace
from acrc_testbed.trace.traces import MOST_BYTES, encode, own_files
from actors.runtime.errors import AcrcError
from actors.runtime.prints import nowhere

_NICE: Final = 19
"""The run comes first."""
_BUDGET_S: Final = 0.5
"""So long it computes before it tells what it has."""
_POLL_S: Final = 0.3


def main(argv: Sequence[str]) -> int:
    """Write the trace of one robot; the exit code."""
    parser = sandboxed.parser("acrc_testbed.trace.program")
    parser.add_argument("--file-mb", type=int, default=MOST_BYTES // 1_000_000, help="at most so much")
    parser.add_argument("--follow", action="store_true", help="the run goes on")
    options = parser.parse_args(argv)
    readable = None
    if options.follow:
        os.nice(_NICE)
        readable = tuple(own_files(recordings(options.out)[options.actor]))
    with sandboxed.answering(options, options.file_mb, readable) as answer:
        make = follow if options.follow else whole
        try:
            for part in make(options.out, options.actor):
                sandboxed.write_whole(answer, encode(part))
        except AcrcError as error:
            sys.stderr.write(f"{error}\n")
            return 2
        except OSError as error:
            sys.stderr.write(f"its trace has more than {options.file_mb} MB: {error}\n")
            return 2
    return 0


def whole(out: Path, actor: str) -> Iterator[Trace]:
    """The trace of a recording, as far as that goes. The robot's code runs in this process.

    Raises an AcrcError where there is nothing to replay.
    """
    collector, fault = Collector(out, actor), None
    try:
        with collector.looking():
            replay_actor(out, actor, Onlook(collector.attach, prints=lambda step_us: nowhere()))
    except AcrcError as error:
        fault = str(error)
    except Exception as error:  # a strategy on another processor may go where it never went
        fault = sandboxed.bug(actor, error)
    yield collector.part(fault)


def follow(out: Path, actor: str) -> Iterator[Trace]:
    """The same part by part, as the recording grows, to its end."""
    collector, fault = Collector(out, actor), None
    try:
        with (
            collector.looking(),
            GrowingReplay(made_again(out, actor, Onlook(collector.attach))) as replay,
        ):
            while not replay.ended:
                told = replay.advance(_BUDGET_S)
                if collector.has_looked:
                    yield collector.part()
                elif told:
                    time.sleep(_POLL_S)
            replay.settle()
    except AcrcError as error:
        fault = str(error)
    except Exception as error:  # a strategy on another processor may go where it never went
        fault = sandboxed.bug(actor, error)
    yield collector.part(fault)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
