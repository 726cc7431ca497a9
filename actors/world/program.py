"""Process of the world: set-up, core and router."""

from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final

import msgspec

from actors.floor import raster
from actors.messages import PROGRESS, ItemMark
from actors.portable import arrays, draws, foundations, hypot
from actors.runtime.core import Bus, Pace, interval_timer, to
from actors.runtime.process import ActorProcess, RunNote, run_note
from actors.runtime.process_setup import read_setup
from actors.runtime.processor import fingerprints
from actors.runtime.shell import Shell, run_shell
from actors.settings import decode
from actors.task.checked_judge import CheckedJudge
from actors.task.loading import decode_items, load_task
from actors.task.task import JudgeSetup, Task
from actors.world import drive, odometry, physics, rays, social_force
from actors.world.body import Bodies
from actors.world.core import WorldCore
from actors.world.order_execution import check_room
from actors.world.world_setup import Participants, WorldProgram, WorldSetup

KERNELS: Final = (foundations, arrays, draws, odometry, drive, physics, rays, raster)
"""Modules with the numeric kernels of every world."""
PEOPLE_KERNELS: Final = (social_force,)
"""Further ones of a world with people."""


def load_setup(path: Path) -> WorldProgram:
    """Read the set-up of a world's process; its paths stay relative. Raises AcrcError."""
    return read_setup(path, WorldProgram, "a world")


def build(setup: WorldSetup) -> WorldCore:
    """Return the core of a world and its judge."""
    task, bodies, participants = load_task(setup.task.use), Bodies(setup), Participants(setup.robots)
    judge_setup = JudgeSetup(
        robots=setup.ids,
        items={robot.id: decode_items(task, robot.items) for robot in setup.robots},
        settings=decode(task.settings, setup.task.settings, setup.task.declaration.table),
        grid=bodies.grid,
        seed=setup.world_seed,
        duration_us=setup.duration_us,
        world=JudgedWorld(task, bodies, participants),
    )
    return WorldCore(setup, bodies, participants, task, CheckedJudge(task, judge_setup))


def initial_marks(setup: WorldSetup) -> tuple[ItemMark, ...]:
    """Return the items that the task's judge shows at the start of a run."""
    return build(setup).judge.take_changes()[0]


class JudgedWorld(msgspec.Struct, frozen=True):
    """The world as its judge may use it, implementing `TaskWorld`."""

    task: Task
    bodies: Bodies
    participants: Participants

    def charge(self, robot: str, watts: float) -> None:
        """Charge the robot's battery during the next step."""
        self.bodies.batteries.charge(self.participants[robot].index, watts)

    def battery(self, robot: str) -> float | None:
        """Return the charge of the robot's battery, 0 to 1; None: not simulated."""
        return self.bodies.batteries.charges[self.participants[robot].index]

    def speed(self, robot: str) -> float:
        """Return the robot's true speed, m/s."""
        _, _, _, vx, vy, _ = self.bodies.truth(self.participants[robot].index)
        return hypot(vx, vy)

    def give(self, robot: str, items: Sequence[Any]) -> None:
        """Send further items to the robot with its next SensorData."""
        member = self.participants[robot]
        decode_items(self.task, msgspec.to_builtins(items))
        check_room(member, items)
        member.given_items += tuple(items)


def actor_process_of(setup: WorldSetup, folder: Path, commit: str) -> ActorProcess:
    """Return the world of a set-up in `folder` without pacing: in memory, and for replays."""
    return actor_process(build(setup.resolve_paths(folder)), world_note(setup, commit))


def actor_process(
    core: WorldCore,
    run: RunNote,
    drive: Callable[[Shell, Bus], None] = run_shell,
) -> ActorProcess:
    """Return the core with its connections."""
    return ActorProcess(
        core=core,
        listens=core.listens(),
        run=run,
        optional_inputs=core.optional_inputs,
        drive=drive,
        outcome=lambda: outcome_of(core),
    )


def outcome_of(core: WorldCore) -> dict[str, object]:
    """Return the world's results by subject; `energy` only with batteries."""
    report = msgspec.to_builtins(core.report())
    if not report["energy"]:
        del report["energy"]
    return {"task": core.task_outcome, **report}


def world_note(setup: WorldSetup, commit: str) -> RunNote:
    """Return the first record of the world's recording."""
    kernels = (*KERNELS, *load_task(setup.task.use).kernels, *(PEOPLE_KERNELS if setup.has_people else ()))
    return run_note("world", setup, commit, seed=setup.seed, kernels=fingerprints(kernels, saved=True))


class Conductor:
    """Drives the world over the mesh: keeps the pace and reports long waits."""

    TICK_S: Final = 0.25
    """Period of checks for waits, s; below half of the shortest timeout, so that the wait is reported
    first."""

    def __init__(self, core: WorldCore, speed: float | None) -> None:
        self._core = core
        self._pace = None if speed is None else Pace(speed)
        self._last_speed: float | None = None

    def drive(self, shell: Shell, bus: Bus) -> None:
        """Run to the end."""
        last_advances = -1

        def tick(frame: FrameType | None) -> None:
            nonlocal last_advances
            if shell.advances == last_advances and not self._core.paused:
                shell.send(to(PROGRESS, self._core.waiting(shell.awaited)))
            last_advances = shell.advances

        with interval_timer(self.TICK_S, tick):
            run_shell(shell, bus, self.wait_for_step)

    def wait_for_step(self) -> None:
        """Wait until the next step is due at the last ordered speed."""
        if self._core.speed != self._last_speed:
            self._last_speed = self._core.speed
            self._pace = Pace(self._last_speed) if self._last_speed else None
        if self._pace is None:
            return
        if self._core.paused:
            self._pace.restart()
        elif self._core.opening:
            self._pace.wait_until(self._core.instant)
