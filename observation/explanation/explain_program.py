"""Explains decisions of one robot in a process that is shut off like a robot's, for its strategy runs here.

`python -m observation.explanation.explain_program --out DIR --actor ROBOT --answer FILE --own DIR` lists its
decisions, with `--at S` explains that of an instant, with `--every` all: the answer is what `decode` reads.
"""

import os

if __name__ == "__main__":  # who imports this has an environment of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import sys
from argparse import Namespace
from collections.abc import Sequence

from actors.runtime.errors import AcrcError
from observation.explanation.explain import ExplainAnswer, Wish, all_explained, encode, explain, listed
from observation.replay import shut_off


def main(argv: Sequence[str]) -> int:
    """Explain, and write down what came of it; the exit code."""
    parser = shut_off.parser("observation.explanation.explain_program")
    parser.add_argument("--at", type=float)
    parser.add_argument("--every", action="store_true")
    parser.add_argument("--file-mb", type=int, required=True, help="the answer has at most so much")
    options = parser.parse_args(argv)
    with shut_off.answering(options, options.file_mb) as answer:
        shut_off.write_whole(answer, encode(_answered(options)))
    return 0


def _answered(options: Namespace) -> ExplainAnswer:
    out, robot = options.out, options.actor
    try:
        if options.every:
            return ExplainAnswer(explanations=tuple(all_explained(out, robot)))
        if options.at is None:
            return ExplainAnswer(decisions=listed(out, robot))
        return ExplainAnswer(explanations=explain(out, Wish(robot, options.at)))
    except AcrcError as error:
        return ExplainAnswer(fault=str(error))
    except Exception as error:  # a strategy on another processor may go where it never went
        return ExplainAnswer(fault=shut_off.bug(robot, error))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
