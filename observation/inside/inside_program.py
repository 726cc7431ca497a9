"""Executes one robot again, looks into it, and ends: in a process that is shut off like a robot's.

`python -m observation.inside.inside_program --out DIR --actor NAME --answer FILE --own DIR`: the answer is
what `telemetry.decode` reads.
"""

import os

if __name__ == "__main__":  # who imports this has an environment of its own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import sys
from collections.abc import Sequence
from pathlib import Path

from actors.instant import Duration
from actors.robot.assembly import RobotSetup
from actors.robot_model import load_model
from actors.runtime.errors import AcrcError
from actors.runtime.process_setup import located_model
from observation.inside.onlooker import RobotOnlooker
from observation.inside.telemetry import MOST_BYTES, Inside, encode
from observation.replay import shut_off
from observation.replay.record_replay import Onlook, replay_actor
from observation.replay.recorded_setup import setup_of
from observation.replay.run_recordings import recordings


def main(argv: Sequence[str]) -> int:
    """Look into one robot, and write down what was seen; the exit code."""
    parser = shut_off.parser("observation.inside.inside_program")
    parser.add_argument("--period-us", type=int, required=True, help="between two looks")
    options = parser.parse_args(argv)
    with shut_off.answering(options, MOST_BYTES // 1_000_000) as answer:
        try:
            inside = look_into(options.out, options.actor, Duration(options.period_us))
        except AcrcError as error:
            sys.stderr.write(f"{error}\n")
            return 2
        shut_off.write_whole(answer, encode(inside))
    return 0


def look_into(out: Path, actor: str, period: Duration) -> Inside:
    """What a robot perceived and meant, once in `period`, as far as its recording goes.

    Its code runs in this process. Raises an AcrcError where there is nothing to execute.
    """
    onlooker = onlooker_of(out, actor, period)
    fault = None
    try:
        replay_actor(out, actor, Onlook(onlooker.attach))
    except AcrcError as error:
        fault = str(error)
    except Exception as error:  # a strategy on another processor may go where it never went
        fault = shut_off.bug(actor, error)
    return onlooker.result(fault)


def onlooker_of(out: Path, actor: str, period: Duration) -> RobotOnlooker:
    """Who is to look into a recorded robot, once in `period`. RecordingError without a first record."""
    path = recordings(out)[actor]
    setup = setup_of(path, RobotSetup, "a robot")
    sensor = load_model(located_model(setup.model, path.parent), setup.sensor).sensor
    return RobotOnlooker(setup.id, sensor, setup.stack.local_map.cell, period)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
