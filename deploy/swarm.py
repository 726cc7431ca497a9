"""A whole run from a plan: processes over the mesh or cores in memory, and the result."""

import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import msgspec

from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress
from actors.runtime import access, isolation
from actors.runtime.core import at
from actors.runtime.memory_bus import MemoryBus
from actors.runtime.zenoh_bus import open_mesh
from deploy.launch import Program, launcher
from deploy.memory_swarm import MemorySwarm
from deploy.plan import (
    Plan,
    issue_credentials,
    lay_out,
    radio_program,
    remove_credentials,
    robot_program,
    world_program,
)  # fmt: skip
from deploy.result import Circumstances, RunResult, gather
from deploy.supervisor import Supervisor

OPERATOR = "operator"
"""Name of the parent process on the mesh."""


class Interrupted(Exception):  # noqa: N818  # what a person or the system asked for is no error
    """The run was ended from outside; `exit_code` is 128 + the signal's number."""

    def __init__(self, exit_code: int) -> None:
        super().__init__(exit_code)
        self.exit_code = exit_code


def run_in_memory(
    plan: Plan, on_progress: Callable[[Progress], None], bus: MemoryBus | None = None
) -> RunResult:
    """Run all actors in this process."""
    began = time.time()
    lay_out(plan)
    swarm = MemorySwarm(plan, bus or MemoryBus(), on_progress)
    with _signals_as_interrupts():
        swarm.run()
    about = _circumstances(plan, began, "memory", 0.0, swarm.rosters)
    return _finish(plan, swarm.programs, about)


def run_processes(plan: Plan, spawn: str, on_progress: Callable[[Progress], None]) -> RunResult:
    """Run every actor as a process of its own; none is left when this returns or raises."""
    began = time.time()
    if plan.isolate and (reason := isolation.available()):
        raise isolation.IsolationError(reason)
    lay_out(plan)
    issued = issue_credentials(plan)
    robots = {robot.id: robot for robot in plan.world.robots}
    first = [robot_program(plan, robot, ProcessOrder(robot.id, 0), 0) for robot in plan.world.robots]
    with _signals_as_interrupts(), launcher(spawn) as launched:
        supervisor = Supervisor(
            launched, lambda order, step: robot_program(plan, robots[order.robot], order, step), on_progress
        )
        try:
            supervisor.start([world_program(plan), radio_program(plan)])
            _await_router(supervisor, issued.sockets[OPERATOR])
            config = access.client_config(issued.files[OPERATOR], issued.endpoint(OPERATOR))
            with open_mesh(config, (at(PROGRESS), at(ROSTER)), patience_s=plan.patience_s) as bus:
                supervisor.start(first)
                supervisor.watch(bus)
        finally:
            supervisor.end_all()
            remove_credentials(plan)
    about = _circumstances(plan, began, "zenoh", time.process_time(), supervisor.rosters)
    return _finish(plan, supervisor.programs, about)


def _await_router(supervisor: Supervisor, socket: Path) -> None:
    """Return when the router listens, so that nobody else has to try again and again."""
    while not socket.exists():
        time.sleep(0.005)
        supervisor.check()


def _finish(plan: Plan, programs: Sequence[Program], about: Circumstances) -> RunResult:
    result = gather(programs, about)
    (plan.out / "run.json").write_bytes(msgspec.json.format(msgspec.json.encode(result)) + b"\n")
    return result


def _circumstances(plan: Plan, began: float, bus: str, cpu_s: float, rosters: int) -> Circumstances:
    return Circumstances(
        out=plan.out,
        robots=[robot.id for robot in plan.world.robots],
        seed=plan.world.seed,
        step_us=plan.world.step_us,
        isolation="full" if plan.isolate and bus == "zenoh" else "credentials" if bus == "zenoh" else "none",
        bus=bus,
        began_s=began,
        parent_cpu_s=cpu_s,
        parent_received=rosters,
    )


@contextmanager
def _signals_as_interrupts() -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP become Interrupted, so that what was started is ended in order."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise Interrupted(128 + number)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, interrupt) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
