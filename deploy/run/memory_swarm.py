"""A run in one process, with the same cores, messages and recordings as one process per actor."""

import contextlib
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from types import FrameType
from typing import Final, NoReturn

from actors.messages import PROGRESS, ROSTER, ProcessOrder, Progress, Roster
from actors.processes.kernel_compilation import kernel_modules
from actors.processes.launcher import Program
from actors.processes.monitor import AwaitedProcess, StallDetector
from actors.processes.watchdog import BoardState, WriteBoard, run_watchdog
from actors.radio.program import actor_process as radio_process
from actors.robot.program import actor_process as robot_process
from actors.robot.program import share
from actors.runtime import captured_output, failure, process_table
from actors.runtime.codec import decode
from actors.runtime.core import Delivery, Pace, at, interval_timer
from actors.runtime.debugger import stop_here
from actors.runtime.errors import AcrcError
from actors.runtime.failure import (
    StepTimeout,
    current_line,
    failure_note,
    failure_sentence,
    own_frames,
)
from actors.runtime.linux import PR_SET_CHILD_SUBREAPER, prctl
from actors.runtime.process import ActorProcess, final_note
from actors.runtime.processor import fingerprints
from actors.runtime.recording import Recorder
from actors.runtime.shell import MemoryBus, Shell, run_shells
from actors.world import program as world_program
from actors.world.core import WorldCore
from deploy.run.dry_run import raise_on_hard_exit
from deploy.run.plan import RunPlan, radio_program, robot_program, shared_arguments
from deploy.run.plan import world_program as world_as_program

_TICK_S: Final = 0.25


def _say(sentence: str) -> None:
    """Print past Python's streams, which a strategy may have redirected."""
    with contextlib.suppress(OSError):
        os.write(2, f"acrc: {sentence}\n".encode())


@contextmanager
def detect_stalls(
    shells: Sequence[Shell],
    stalls: StallDetector,
    current_state: Callable[[], BoardState],
    on_uninterruptible: Callable[[str], None],
) -> Iterator[None]:
    """Raise StepTimeout in the main thread if none of the `shells` advances in time.

    `current_state`: returns the current actor and its step. `on_uninterruptible` is called if user code has
    caught StepTimeout repeatedly; it must not return. A swarm in another thread is not monitored, because
    only the main thread receives signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    advances = -1
    timeouts = 0

    def tick(frame: FrameType | None) -> None:
        nonlocal advances, timeouts
        now = sum(shell.advances for shell in shells)
        if now != advances:
            advances = now
            stalls.step()
            return
        state = current_state()
        awaited = (AwaitedProcess(state.actor, os.getpid()),)
        stall = stalls.check(awaited, awaited, state.description())
        if stall is not None:
            timeouts += 1
            sentence = f"{stall.sentence}; it is at {current_line(frame)}"
            if timeouts > 3:
                on_uninterruptible(sentence)
            raise StepTimeout(sentence)

    with interval_timer(_TICK_S, tick):
        yield


@contextmanager
def end_leftovers() -> Iterator[None]:
    """Kill child processes that strategies have left; raise AcrcError if any, or any thread, is left."""
    threads, children = threading.enumerate(), process_table.children(os.getpid(), process_table.processes())
    _adopt_orphans(True)
    try:
        yield
    finally:
        leftovers = process_table.children(os.getpid(), process_table.processes()) - children
        fault = process_table.leftover_fault(process_table.kill_orphans(leftovers) > 0, threads)
        _adopt_orphans(False)
    if fault is not None:
        raise AcrcError(f"a strategy failed: {fault}")


def _adopt_orphans(adopt: bool) -> None:
    if sys.platform == "linux":
        # Process emulators lack this call; without it, only direct children are found.
        with contextlib.suppress(OSError):
            prctl(PR_SET_CHILD_SUBREAPER, int(adopt))


class MemorySwarm:
    """All actors of one run in one process."""

    def __init__(self, plan: RunPlan, bus: MemoryBus, on_progress: Callable[[Progress], None]) -> None:
        self._plan = plan
        self._bus = bus
        self._on_progress = on_progress
        self._stack = ExitStack()
        self._actors: list[tuple[Program, ActorProcess, Shell, Recorder]] = []
        self._shells: list[Shell] = []
        self._core: WorldCore | None = None
        self._current: Shell | None = None
        self._shared: list[object] = []
        """Data shared by the robots, kept for robots that start later."""
        self._pace = None if plan.options.speed == "max" else Pace(float(plan.options.speed))
        self._write_board: WriteBoard | None = None
        """Publishes the current actor for the watchdog."""
        self.stalls = StallDetector(
            plan.timeout,
            _say,
            table=lambda: {os.getpid(): process_table.ProcessState(0, 0, "S", time.process_time())},
        )
        """Stalls and delays of the actors' steps."""
        self.rosters = 0
        """Roster messages received."""

    @property
    def programs(self) -> tuple[Program, ...]:
        """The program that each actor would have as a process."""
        return tuple(program for program, _, _, _ in self._actors)

    def run(self) -> None:
        """Execute the run; in any case close the recordings, with a note about the end or the failure."""
        with self._stack:
            if self._plan.has_user_code:
                self._write_board = self._stack.enter_context(run_watchdog(self._plan.timeout.step_s))
            failure.hold_reserve(self._plan.out)
            self._stack.callback(failure.release_reserve)
            with end_leftovers():
                try:
                    self._execute()
                except (SystemExit, StepTimeout) as error:
                    raise AcrcError(self._note_failure(error)) from None
                except Exception as error:
                    failure.release_reserve()  # first, because memory may be too short even for a call
                    sentence = self._note_failure(error)
                    if isinstance(error, AcrcError) or not (frames := own_frames(error)):
                        raise
                    raise AcrcError(f"{sentence}\n{frames}".rstrip()) from error
            cpu_s = time.process_time() / len(self._actors)  # one process: equal shares
            for _, process, shell, recorder in self._actors:
                recorder.note("final", final_note(shell, process, cpu_s))

    def _execute(self) -> None:
        fingerprints(kernel_modules(), saved=True)  # before any timeout: computing them ever takes a minute
        with (
            self._breakpoints(),
            raise_on_hard_exit(),
            detect_stalls(self._shells, self.stalls, self._current_state, self._kill_process),
            captured_output.captured_by(None),
        ):
            self._build()
            with _infrequent_collection():
                run_shells(self._shells, self._before_turn)
            failure.release_reserve()  # reserve for an orderly end: user code may have left no memory

    @contextmanager
    def _breakpoints(self) -> Iterator[None]:
        """Enable breakpoints of the debugged robot only."""
        debug = self._plan.debug
        if debug is None:
            yield
            return

        def stop(*args: object, **kwargs: object) -> None:
            if self._current is not None and self._current.actor == debug.robot:
                stop_here(sys._getframe(1))

        before, sys.breakpointhook = sys.breakpointhook, stop
        try:
            yield
        finally:
            sys.breakpointhook = before

    def _build(self) -> None:
        plan = self._plan
        self._bus.listen(at(PROGRESS), self._on_message)
        self._bus.listen(at(ROSTER), self._on_message)
        world, radio = world_as_program(plan), radio_program(plan)
        assert world.setup is not None and radio.setup is not None
        process = world_program.actor_process_of(world.setup.actor, plan.folder("world"), plan.commit)
        assert isinstance(process.core, WorldCore)
        self._core = process.core
        self._add(world, process)
        self._add(radio, radio_process(radio.setup.actor, plan.folder("radio"), plan.commit))
        self._shared = [share(*words) for words in shared_arguments(plan)]
        for robot in plan.world.robots:
            self._add_robot(robot_program(plan, robot, ProcessOrder(robot.id, 0), 0), 0)

    def _add_robot(self, program: Program, first_step: int) -> None:
        """Start a robot; its output goes to its log as with a process, unless it is debugged."""
        assert program.setup is not None
        folder = self._plan.folder(program.actor)
        if self._plan.debug is not None and program.actor == self._plan.debug.robot:
            self._add(program, robot_process(program.setup, folder))
            return
        printed = captured_output.output_to_file(program.log, self._plan.world.step_us)
        self._stack.callback(printed.close)
        with printed.during(first_step):
            process = robot_process(program.setup, folder)
        self._add(program, process)
        self._shells[-1].prints = printed

    def _add(self, program: Program, process: ActorProcess) -> None:
        assert program.record is not None
        recorder = self._stack.enter_context(Recorder(program.record, process.run.step_us))
        recorder.note("run", process.run)
        shell = Shell(
            process.core,
            self._bus,
            recorder,
            actor=process.run.actor,
            optional_inputs=process.optional_inputs,
        )
        for address in process.listens:
            self._bus.listen(address, shell.deliver)
        self._actors.append((program, process, shell, recorder))
        self._shells.append(shell)
        if process.ready is not None:
            shell.send(process.ready)

    def _note_failure(self, error: BaseException) -> str:
        """Record the failure for the current actor; other recordings are truncated, as with processes."""
        note = failure_note("the run", 0, error)
        for _, process, shell, recorder in self._actors:
            if shell is self._current:
                note = failure_note(process.run.actor, shell.core.step, error)
                recorder.note("failure", note)
        return failure_sentence(note)

    def _current_state(self) -> BoardState:
        shell = self._current
        return BoardState(0, "") if shell is None else BoardState(shell.core.step, shell.actor)

    def _kill_process(self, sentence: str) -> NoReturn:
        """Kill this process: its user code catches every exception."""
        self._note_failure(StepTimeout(sentence))
        self._stack.close()
        sys.stderr.write(f"acrc: {sentence}\n")
        sys.stderr.flush()
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError

    def _before_turn(self, shell: Shell) -> None:
        assert self._core is not None
        self._current = shell
        if self._write_board is not None:
            self._write_board(shell.core.step, shell.actor)
        if self._pace is not None and shell.core is self._core and self._core.opening:
            self._pace.wait_until(self._core.instant)

    def _on_message(self, delivery: Delivery) -> None:
        message = decode(delivery.topic, delivery.key, delivery.payload)
        if isinstance(message, Progress):
            self._on_progress(message)
        elif isinstance(message, Roster):
            self.rosters += 1
            self._restart(message)

    def _restart(self, roster: Roster) -> None:
        robots = {robot.id: robot for robot in self._plan.world.robots}
        for order in roster.start:
            for program, _, shell, _ in self._actors:
                if program.actor == order.robot:
                    while not shell.finished and shell.pump() is None:
                        pass
                    self._bus.leave(shell.deliver)
            program = robot_program(self._plan, robots[order.robot], order, roster.step)
            self._add_robot(program, roster.step)


@contextmanager
def _infrequent_collection() -> Iterator[None]:
    """Exclude present objects from garbage collection, and collect rarely.

    A hundred robots create thousands of small objects per step, but hardly any cycles. If the process has
    frozen its initial objects, collections are cheap and these stay frozen.
    """
    before, is_frozen = gc.get_threshold(), gc.get_freeze_count() > 0
    if not is_frozen:
        gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    try:
        yield
    finally:
        gc.set_threshold(*before)
        if not is_frozen:
            gc.unfreeze()
