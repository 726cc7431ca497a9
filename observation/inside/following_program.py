"""Executes one robot of a run that is going on again, and tells what it perceives and means: shut off.

`python -m observation.inside.following_program --out DIR --actor NAME --answer FILE --own DIR`: the answer
grows by what `telemetry.decode` reads, each part with its length before it (`PART`). Ends with the recording.
"""

import os

if __name__ == "__main__":  # who imports this has an environment of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import stat
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from actors.instant import Duration
from actors.runtime.errors import AcrcError
from observation.inside.inside_program import onlooker_of
from observation.inside.telemetry import MOST_BYTES, PART, Inside, encode
from observation.replay import shut_off
from observation.replay.growing_replay import GrowingReplay
from observation.replay.record_replay import Onlook, made_again
from observation.replay.run_recordings import recordings

_NICE: Final = 19
"""The run comes first."""
_BUDGET_S: Final = 0.5
"""So long it computes before it tells what it has."""
_POLL_S: Final = 0.3


def main(argv: Sequence[str]) -> int:
    """Look into one robot until its recording ends; the exit code."""
    parser = shut_off.parser("observation.inside.following_program")
    parser.add_argument("--period-us", type=int, required=True, help="between two looks")
    options = parser.parse_args(argv)
    os.nice(_NICE)
    path = recordings(options.out)[options.actor]
    with shut_off.answering(options, 2 * MOST_BYTES // 1_000_000, tuple(_readable(path))) as answer:
        room = MOST_BYTES
        try:
            for inside in _look(options.out, options.actor, Duration(options.period_us)):
                data = encode(inside)
                room -= len(data)
                if room < 0:
                    raise AcrcError(f"{options.actor}: is drawn no further: it has told {MOST_BYTES} bytes")
                shut_off.write_whole(answer, PART.pack(len(data)) + data)
        except AcrcError as error:
            sys.stderr.write(f"{error}\n")
            return 2
    return 0


def _readable(path: Path) -> Iterator[Path]:
    """The recording, and what its robot read before its first step; no password, and no way to others."""
    for file in sorted(path.parent.iterdir()):
        wanted = file == path or file.suffix == ".toml" or file.stem == "map"
        if wanted and stat.S_ISREG(file.lstat().st_mode):
            yield file


def _look(out: Path, actor: str, period: Duration) -> Iterator[Inside]:
    """What there is to tell, as it comes; the last one may have a fault."""
    onlooker = onlooker_of(out, actor, period)
    try:
        with GrowingReplay(made_again(out, actor, Onlook(onlooker.attach))) as replay:
            while not replay.ended:
                told = replay.advance(_BUDGET_S)
                inside = onlooker.result()
                if len(inside.instants):
                    yield inside
                elif told:
                    time.sleep(_POLL_S)
        fault = None
    except AcrcError as error:
        fault = str(error)
    except Exception as error:  # a strategy on another processor may go where it never went
        fault = shut_off.bug(actor, error)
    yield onlooker.result(fault)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
