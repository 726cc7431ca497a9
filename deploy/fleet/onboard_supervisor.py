"""Keeps a robot's processes running, within a budget of restarts, until it is told to stop."""

import signal
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from actors.processes.last_word import last_line, last_lines
from actors.processes.launch import Child, Launcher, Program
from actors.runtime.errors import AcrcError
from deploy.fleet import onboard as layout
from deploy.fleet.onboard import Onboard


@dataclass(frozen=True)
class RestartBudget:
    """How often processes may be started anew; systemd starts the whole robot again after that."""

    starts: int = 5
    """Own choice: a fault that comes back at once is no accident."""
    within_s: float = 60.0


class OnboardSupervisor:
    """One robot's three processes; a base that ends takes the others along, for it is their router."""

    START_S = 120.0
    """How long a base may take to listen; after that it hangs, and is killed."""
    GRACE_S = 5.0
    """How long a process may take to end after it was asked to."""

    def __init__(
        self,
        onboard: Onboard,
        launcher: Launcher,
        say: Callable[[str], None],
        budget: RestartBudget = RestartBudget(),
        lives: Callable[[], None] = lambda: None,
    ) -> None:
        """`say` is told what happens, a sentence at a time; `lives` is called again and again."""
        self._lives = lives
        self._onboard = onboard
        self._launcher = launcher
        self._say = say
        self._budget = budget
        self._starts: deque[float] = deque()
        self._count = {layout.BASE: 0, layout.BRIDGE: 0, onboard.robot.id: 0}
        self._children: dict[str, Child] = {}
        self._losses: dict[Path, str] = {}
        """What was said of recordings that are not whole."""
        self.programs: list[Program] = []
        """Every program that was started, in order."""

    @property
    def restarts(self) -> int:
        """Starts beyond the first of each."""
        return sum(max(0, count - 1) for count in self._count.values())

    @property
    def base_pid(self) -> int | None:
        """Of the base process; None while there is none."""
        base = self._children.get(layout.BASE)
        return None if base is None or base.exit_code is not None else base.pid

    def start(self) -> None:
        """Start base, bridge and robot."""
        self._launcher.withdraw(self._onboard.router)
        issued = layout.issue(self._onboard)
        self._start(layout.BASE)
        socket = issued.sockets[layout.BRIDGE]
        deadline = time.monotonic() + self.START_S
        while not socket.exists():
            self._launcher.wait(0.005)
            if time.monotonic() > deadline:
                self._children[layout.BASE].send(signal.SIGKILL)
            self._lives()
            if self._children[layout.BASE].exit_code is not None:
                return  # look() starts it again, or gives up
        self._start(layout.BRIDGE)
        self._start(self._onboard.robot.id)

    def look(self, patience_s: float) -> bool:
        """Wait so long, and start again what has ended; False once the base has ended as it was told to.

        Raises AcrcError when the budget is used up.
        """
        self._launcher.wait(patience_s)
        self._lives()
        self._tell_losses()
        ended = [name for name, child in self._children.items() if child.exit_code is not None]
        if not ended:
            return True
        if all(self._children[name].exit_code == 0 for name in ended):
            self._await([self._children[layout.BASE]])  # it told them to end, and is about to end itself
        if self._children[layout.BASE].exit_code == 0:
            self.end()
            return False
        for name in ended:
            self._say(f"{name} has ended {_cause(self._children[name])}")
        self._spend(ended[0])
        if layout.BASE in ended:
            self.end()
            layout.withdraw(self._onboard)
            self.start()
            return True
        for name in ended:
            self._start(name)
        return True

    def end(self) -> None:
        """Stop the vehicle, and end all processes."""
        base = self._children.get(layout.BASE)
        if base is not None and base.exit_code is None:
            base.send(signal.SIGTERM)  # stands, halts the robot, lets the bridge go
            self._await(list(self._children.values()))
        for number in (signal.SIGTERM, signal.SIGKILL):
            running = [child for child in self._children.values() if child.exit_code is None]
            for child in running:
                child.send(number)
            self._await(running)
        self._tell_losses()

    def _start(self, name: str) -> None:
        number = self._count[name]
        self._count[name] += 1
        if name == layout.BASE:
            program = layout.base_program(self._onboard, number)
        elif name == layout.BRIDGE:
            program = layout.bridge_program(self._onboard, number)
        else:
            program = layout.onboard_robot_program(self._onboard, number)
        self.programs.append(program)
        self._children[name] = self._launcher.start(program)

    def _spend(self, name: str) -> None:
        now = time.monotonic()
        self._starts.append(now)
        while self._starts and self._starts[0] < now - self._budget.within_s:
            self._starts.popleft()
        if len(self._starts) > self._budget.starts:
            self.end()
            raise AcrcError(
                f"{self._onboard.robot.id}: its processes were started {self._budget.starts} times within "
                f"{self._budget.within_s:g} s, and {name} has ended once more {_cause(self._children[name])}"
            )

    def _tell_losses(self) -> None:
        """Say which recordings the disk does not take, as each process says it of its own in its log."""
        for name, child in self._children.items():
            record = child.program.record
            if record is None:
                continue
            said = map(child.program.in_our_words, last_lines(child.program.log))
            told = next((line for line in said if line.startswith(f"{record}: ")), None)
            if told is not None and self._losses.get(record) != told:
                self._losses[record] = told
                self._say(f"{name}: {told}")

    def _await(self, children: list[Child]) -> None:
        deadline = time.monotonic() + self.GRACE_S
        while any(child.exit_code is None for child in children) and time.monotonic() < deadline:
            self._launcher.wait(0.05)
            self._lives()


def _last_word(child: Child) -> str:
    return child.program.in_our_words(last_line(child.program.log))


def _cause(child: Child) -> str:
    """How a process has ended, and why, as far as it says."""
    last = _last_word(child)
    code = child.exit_code or 0
    how = f"by signal {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
    return f"{how}{f': {last}' if last else ''}"
