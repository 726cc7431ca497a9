"""Where each robot of a run truly was at each step, and what it held and wanted."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.messages import Jam
from observation.evidence.run_evidence import RunEvidence


class TimedJam(NamedTuple):
    """A jammer, from one instant until another one, µs."""

    begin: int
    jam: Jam


@dataclass(frozen=True, eq=False)
class Tracks:
    """All robots of one run at the start of each step."""

    robots: tuple[str, ...]
    step_us: int
    true: NDArray[np.float64]
    """(steps, robots, 3): x, y in m and heading in rad, map frame, as the world has it."""
    held: NDArray[np.float64]
    """(steps, robots, 3): where the robot holds itself to be; NaN where it has not said so."""
    wished: NDArray[np.float64]
    """(steps, robots, 3): the velocity that it asks for from then on, in its own frame: m/s, m/s, rad/s; NaN
    where it asks for none."""
    stepping: NDArray[np.bool_]
    """(steps, robots): False where its process was ended or frozen."""
    busy: NDArray[np.bool_]
    """(steps, robots): False where it has said that it means to visit no place any more."""
    jams: tuple[TimedJam, ...] = ()
    frozen: NDArray[np.bool_] | None = None
    """(steps, robots): of those that do not step, whose processes live still; None: none."""

    def index(self, instant: int) -> int:
        """The step that begins at the instant, or the last one before the end of the run."""
        return min(instant // self.step_us, len(self.true) - 1)


def tracks_of(run: RunEvidence) -> Tracks:
    """What a run's recordings show of it."""
    return Tracks(
        robots=run.robots,
        step_us=run.setup.step_us,
        true=run.true,
        held=run.held,
        wished=run.wished,
        stepping=run.stepping,
        busy=run.left > 0,
        jams=tuple(TimedJam(round(second * 1e6), jam) for second, jam in run.jams),
        frozen=run.powered & ~run.stepping,
    )
