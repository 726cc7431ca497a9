"""Everything that a trace of one robot has, collected while its process is replayed."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, cast

from actors.instant import milliseconds
from actors.robot.assembly import RobotSetup
from actors.robot.core import RobotCore
from actors.robot_model import load_model
from actors.runtime.core import Core
from actors.runtime.process_setup import located_model
from deeco.node import looking_on
from observation.replay.recorded_setup import setup_of
from observation.replay.run_recordings import recordings
from observation.trace.knowledge import Tracer
from observation.trace.perception import Perception
from observation.trace.rows import Trace

PERIOD: Final = milliseconds(500)
"""Between two close looks: as often as a person can follow."""


class Collector:
    """Collects from one core: `attach` belongs into `Onlook`, all of the replay into `looking`."""

    def __init__(self, out: Path, actor: str) -> None:
        """RecordingError for a recording without a first record."""
        path = recordings(out)[actor]
        setup = setup_of(path, RobotSetup, "a robot")
        sensor = load_model(located_model(setup.model, path.parent), setup.sensor).sensor
        self._perception = Perception(setup.id, sensor, setup.stack.local_map.cell, PERIOD)
        self._tracer = Tracer()

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Nodes that are made meanwhile tell what they do."""
        with looking_on(self._tracer):
            yield

    def attach(self, core: Core, step_us: int) -> None:
        """Look at every step of the core from now on."""
        self._perception.attach(core, step_us)
        self._tracer.prepare(core, step_us)
        self._tracer.orders.attach(cast(RobotCore, core))

    @property
    def has_looked(self) -> bool:
        """There was a close look since the last part."""
        return self._perception.has_looked

    def part(self, fault: str | None = None) -> Trace:
        """What is new since the last part; `fault`: why the robot cannot be followed any further."""
        tracer = self._tracer
        part = Trace(
            **self._perception.taken(),
            changes=tuple(tracer.changes),
            news=tuple(tracer.news),
            orders=tuple(tracer.orders.found),
            has_nodes=tracer.has_nodes,
            fault=fault,
        )
        tracer.changes, tracer.news, tracer.orders.found = [], [], []
        return part
