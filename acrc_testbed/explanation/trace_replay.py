"""Causal traces by replay of robots, sandboxed where the machine supports it.

`python -m acrc_testbed.explanation.trace_replay --out DIR --actor NAME --answer FILE --own DIR` replays one
robot and writes its trace, which `causal_trace.decode` reads.
"""

import os
from dataclasses import replace

if __name__ == "__main__":  # not in an importing process
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs one thread

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, cast

import msgspec

from acrc_testbed.explanation.causal_trace import CausalTrace, TraceError, decode
from acrc_testbed.explanation.tracer import Tracer
from acrc_testbed.recordings import sandboxed_replay
from acrc_testbed.recordings.record_replay import ReplayOptions, replay_actor
from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.recordings.sandboxed_replay import ProgramLimits, run_program
from actors.robot.behaviour.code_permit import Permit
from actors.robot.core import RobotCore
from actors.runtime.captured_output import discarded_output
from actors.runtime.core import Core
from actors.runtime.errors import AcrcError
from actors.runtime.recording.reader import report_damage
from deeco.node import observing_nodes

_PROGRAM: Final = "acrc_testbed.explanation.trace_replay"
BOUNDS: Final = ProgramLimits(1 << 30)
"""Limits of a trace; ten minutes of a robot take about 20 MB."""


def trace(
    out: Path, actor: str, *, permit: Permit, isolate: bool, bounds: ProgramLimits = BOUNDS
) -> CausalTrace:
    """Replay a robot's process and return its trace; `isolate`: see `actors.runtime.isolation.sandbox`.

    Raises TraceError for a fault, AcrcError for code that is not permitted.
    """
    report_damage(all_recordings(out)[actor])
    words = ("--file-mb", str(max(1, bounds.max_bytes // 1_000_000)))
    answer = run_program(out, _PROGRAM, actor, words, bounds, permit=permit, isolate=isolate)
    if answer.data is None:
        raise TraceError(answer.fault)
    causal_trace = decode(answer.data, actor)
    if causal_trace.fault is not None:
        raise TraceError(causal_trace.fault)
    return causal_trace


def trace_here(out: Path, actor: str, replay_options: ReplayOptions) -> CausalTrace:
    """Return the trace of a recording up to its end or the first fault. The code runs in this process."""
    tracer, fault = Tracer(), None

    def attach(core: Core, step_us: int) -> None:
        tracer.prepare(core, step_us)
        tracer.orders.attach(cast(RobotCore, core))
        if replay_options.prepare is not None:
            replay_options.prepare(core, step_us)

    try:
        with observing_nodes(tracer):
            replay_actor(out, actor, replace(replay_options, prepare=attach))
    except AcrcError as error:
        fault = str(error)
    except Exception as error:  # a strategy may diverge on another processor
        fault = sandboxed_replay.describe_failure(actor, error)
    return CausalTrace(
        tuple(tracer.changes),
        tuple(tracer.news),
        tuple(tracer.orders.found),
        tracer.has_nodes,
        tracer.end,
        fault,
    )


def main(argv: Sequence[str]) -> int:
    """Write the trace of one robot; return the exit code."""
    parser = sandboxed_replay.argument_parser(_PROGRAM)
    parser.add_argument("--file-mb", type=int, required=True, help="limit of the answer")
    options = parser.parse_args(argv)
    with sandboxed_replay.open_answer(options, options.file_mb) as answer:
        try:
            found = trace_here(
                options.out, options.actor, ReplayOptions(prints=lambda step_us: discarded_output())
            )
            sandboxed_replay.write_all(answer, msgspec.msgpack.encode(found))
        except AcrcError as error:
            sys.stderr.write(f"{error}\n")
            return 2
        except OSError as error:
            sys.stderr.write(f"the trace is larger than {options.file_mb} MB: {error}\n")
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
