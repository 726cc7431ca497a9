"""Stalled steps: the robot named, its timeout and progress notices."""

import pytest

from actors.processes.monitor import (
    AwaitedProcess,
    Stall,
    StallDetector,
    StepDelays,
    Timeout,
    delay_sentences,
)
from actors.runtime.process_table import ProcessState

R1, R2 = AwaitedProcess("r1", 11), AwaitedProcess("r2", 12)
BOTH = (R1, R2)
KEEPER, WORKER, CHILD = 12, 112, 1112
"""r2 is an isolated robot: a keeper process starts its worker."""
IDLE = Stall(R2, "no Drive from r2 for 30 s")
WORKED = Stall(R2, "no Drive from r2 after 30 s of CPU time")


class Machine:
    """A simulated clock and process table."""

    def __init__(self, queued_s: float | None = None) -> None:
        self.now_s = 100.0
        self.said: list[str] = []
        self.cpu_s = {11: 1.0, KEEPER: 0.1, WORKER: 1.0}
        self.state = {11: "S", KEEPER: "S", WORKER: "S"}
        self.stalls = StallDetector(
            Timeout(), self.said.append, lambda: self.now_s, self.table, lambda pid: self.queued_s
        )

        self.queued_s = queued_s
        self.pass_by(0.5)  # the first look only shows how much each has worked so far

    def table(self) -> dict[int, ProcessState]:
        parents = {11: 1, KEEPER: 1, WORKER: KEEPER, CHILD: WORKER}
        return {pid: ProcessState(parents[pid], 1, self.state[pid], self.cpu_s[pid]) for pid in self.state}

    def pass_by(
        self, seconds: float, *, working: float = 0.0, every: float = 0.5, starting: bool = False
    ) -> Stall | None:
        """Check while r2 works for a share of the time; return the first verdict."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += every
            self.cpu_s[WORKER] += working * every
            found = self.stalls.check(BOTH, (R2,), "no Drive from r2", "start" if starting else "step")
            if found is not None:
                return found
        return None


@pytest.fixture
def machine() -> Machine:
    return Machine()


def test_an_idle_robot_is_named_after_30_s_and_a_working_one_after_30_s_of_work(machine: Machine) -> None:
    assert machine.pass_by(29.5) is None
    assert machine.pass_by(1.0) == IDLE
    machine = Machine()
    assert machine.pass_by(290.0, working=0.1) is None
    assert machine.pass_by(20.0, working=0.1) == WORKED


def test_until_it_is_ready_it_may_work_ten_times_as_long_but_not_idle_longer(machine: Machine) -> None:
    assert machine.pass_by(299.0, working=1.0, starting=True) is None
    assert machine.pass_by(2.0, working=1.0, starting=True) == (
        R2, "no Drive from r2 after 300 s of CPU time"
    )  # fmt: skip
    machine.stalls.step()
    machine.pass_by(0.5)
    assert machine.pass_by(31.0, starting=True) == IDLE


@pytest.mark.parametrize(
    ("state", "of_child"), [("R", None), ("D", None), ("D", "D")], ids=["processor", "disk", "child's disk"]
)
def test_a_process_that_waits_for_a_processor_or_a_disk_is_not_idle(
    machine: Machine, state: str, of_child: str | None
) -> None:
    machine.state[WORKER] = state
    if of_child is not None:
        machine.state[CHILD], machine.cpu_s[CHILD] = of_child, 0.0
    assert machine.pass_by(3600.0) is None
    if of_child is not None:
        assert machine.stalls.activity(R2) == "is waiting for a disk"


def test_a_process_that_waits_for_its_child_is_idle(machine: Machine) -> None:
    """As after vfork(2): the parent is in disk sleep until the child exits."""
    machine.state |= {WORKER: "D", CHILD: "S"}
    machine.cpu_s[CHILD] = 0.0
    assert machine.pass_by(28.0) is None
    assert machine.stalls.activity(R2) == "is waiting for a child process"
    assert machine.pass_by(3.0) == IDLE


@pytest.mark.parametrize("pid", [11, KEEPER, WORKER])
def test_no_process_is_named_while_one_of_the_run_is_stopped(machine: Machine, pid: int) -> None:
    assert machine.pass_by(25.0) is None
    machine.state[pid] = "T"
    assert machine.pass_by(3600.0) is None
    assert machine.stalls.stopped == {"r1" if pid == 11 else "r2"}
    machine.state[pid] = "S"
    assert machine.pass_by(4.0) is None, "idle time from before counts, stopped time does not"
    assert machine.stalls.stopped == frozenset()
    assert machine.pass_by(2.0) == IDLE


def test_a_suspended_computer_counts_as_two_checks(machine: Machine) -> None:
    assert machine.pass_by(28.0) is None
    assert machine.pass_by(36_000.0, every=36_000.0) is None
    assert machine.pass_by(2.0) == IDLE


def test_a_step_restarts_the_timeout_and_only_awaited_living_robots_are_named(machine: Machine) -> None:
    for _ in range(3):
        assert machine.pass_by(29.0) is None
        machine.stalls.step()
        machine.pass_by(0.5)
    for _ in range(2):  # r1 is idle throughout, and not awaited
        assert machine.pass_by(29.0, working=0.5) is None
    machine = Machine()
    gone = AwaitedProcess("r3", 999)
    for _ in range(20):
        machine.now_s += 0.5
        assert machine.stalls.check((*BOTH, gone), (gone,), "no Drive from r3") is None


@pytest.mark.parametrize("working", [0.3, 0.7])
def test_a_robot_that_alternates_work_and_sleep_gets_no_extra_time(working: float) -> None:
    machine = Machine(queued_s=0.0)
    assert machine.pass_by(29.5, working=working) is None
    assert machine.pass_by(1.0, working=working) == Stall(
        R2, f"no Drive from r2 for 30 s, {30 * working:.0f} s of it CPU time"
    )


def test_time_spent_waiting_for_a_processor_does_not_count() -> None:
    """r2 gets a tenth of a processor and would use all of it."""
    machine, found = Machine(queued_s=0.0), []
    for _ in range(610):
        machine.queued_s = (machine.queued_s or 0.0) + 0.225
        found.append(machine.pass_by(0.5, working=0.1))
    assert found[:590] == [None] * 590 and found[-1] == WORKED


def test_steps_that_a_robot_delays_are_counted_with_their_time(machine: Machine) -> None:
    for lasted_s in (0.5, 2.5, 2.0, 0.5):
        machine.stalls.step()
        machine.pass_by(lasted_s)
    machine.stalls.step()
    assert machine.stalls.held_up == {"r2": StepDelays(2, 2.5, 4.5)}
    machine.pass_by(4.0, working=1.0)
    again = machine.stalls.held_up["r2"]  # the one that lasts is among them
    assert (again.steps, round(again.most_s, 6), again.total_s) == (3, 4.0, 8.5)
    assert list(delay_sentences(machine.stalls.held_up)) == [
        "r2 delayed 3 steps, by up to 4.0 s, 8.5 s in total."
    ]


@pytest.mark.parametrize("state", ["R", "D", "T"])
def test_steps_that_the_machine_delays_are_not_counted(machine: Machine, state: str) -> None:
    machine.state[WORKER] = state
    for _ in range(3):
        machine.pass_by(8.0)
        machine.stalls.step()
    assert machine.stalls.held_up == {}


def test_a_long_step_and_the_robot_that_delayed_it_are_reported(machine: Machine) -> None:
    machine.pass_by(21.0)
    machine.stalls.step()
    machine.stalls.step()
    assert machine.said == [
        "no Drive from r2 for 10 s; r2 is idle",
        "no Drive from r2 for 20 s; r2 is idle",
        "r2 delayed 1 step, by up to 21.5 s, 21.5 s in total.",
    ]
