"""Executes one robot again for an export, and ends: in a process that is shut off like a robot's.

`python -m observation.export.export_program --out DIR --actor NAME --answer FILE --own DIR`: the answer is
what `answered.read_answer` reads.
"""

import os

if __name__ == "__main__":  # who imports this has an environment of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import sys
from collections.abc import Sequence
from pathlib import Path

from actors.runtime.errors import AcrcError
from observation.export.answered import RowsAnswer, encode
from observation.export.robot_rows import robot_rows
from observation.replay import shut_off


def main(argv: Sequence[str]) -> int:
    """Execute, and write down what came of it; the exit code."""
    parser = shut_off.parser("observation.export.export_program")
    parser.add_argument("--file-mb", type=int, required=True, help="the answer has at most so much")
    options = parser.parse_args(argv)
    with shut_off.answering(options, options.file_mb) as answer:
        shut_off.write_whole(answer, encode(_answered(options.out, options.actor)))
    return 0


def _answered(out: Path, actor: str) -> RowsAnswer:
    try:
        return RowsAnswer(robot_rows(out, actor))
    except AcrcError as error:
        return RowsAnswer(fault=str(error))
    except Exception as error:  # a strategy on another processor may go where it never went
        return RowsAnswer(fault=shut_off.bug(actor, error))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
