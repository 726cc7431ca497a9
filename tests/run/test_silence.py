"""Who is blamed when a run takes no step: told by a false clock and a false table of processes."""

import pytest

from actors.processes.silence import HoldUp, Silence, SilenceVerdict, Suspect, Timeout, sentences
from actors.runtime.lifecycle.process_table import ProcessGlance

R1, R2 = Suspect("r1", 11), Suspect("r2", 12)
BOTH = (R1, R2)
KEEPER, WORKER, CHILD = 12, 112, 1112
"""r2 is looked after by a process of its own, as isolated robots are."""


class Machine:
    """Its clock and its processes, as the test sets them."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.cpu_s = {11: 1.0, KEEPER: 0.1, WORKER: 1.0}
        self.state = {11: "S", KEEPER: "S", WORKER: "S"}
        self.silence = Silence(Timeout(), lambda: self.now_s, self.table, lambda pid: self.queued_s)
        self.queued_s: float | None = None

    def table(self) -> dict[int, ProcessGlance]:
        parents = {11: 1, KEEPER: 1, WORKER: KEEPER, CHILD: WORKER}
        return {pid: ProcessGlance(parents[pid], 1, self.state[pid], self.cpu_s[pid]) for pid in self.state}

    def pass_by(
        self, seconds: float, *, working: float = 0.0, every: float = 0.5, starting: bool = False
    ) -> SilenceVerdict | None:
        """Look every so often while r2 works for this share of the time; the first verdict."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s += every
            self.cpu_s[WORKER] += working * every
            found = self.silence.verdict(BOTH, (R2,), "no Drive from r2", starting=starting)
            if found is not None:
                return found
        return None


@pytest.fixture
def machine() -> Machine:
    machine = Machine()
    machine.pass_by(0.5)  # the first look only shows how much everybody has worked so far
    return machine


def test_who_does_nothing_is_blamed_after_thirty_seconds(machine: Machine) -> None:
    assert machine.pass_by(29.5) is None
    assert machine.pass_by(1.0) == SilenceVerdict(R2, "no Drive from r2 for 30 s")


def test_who_works_is_blamed_after_thirty_seconds_of_work_however_long_that_takes(machine: Machine) -> None:
    assert machine.pass_by(290.0, working=0.1) is None
    assert machine.pass_by(20.0, working=0.1) == SilenceVerdict(
        R2, "no Drive from r2 after 30 s of processor time"
    )


def test_until_it_is_ready_it_may_work_ten_times_as_long_but_not_idle_longer(machine: Machine) -> None:
    assert machine.pass_by(299.0, working=1.0, starting=True) is None
    assert machine.pass_by(2.0, working=1.0, starting=True) == (
        R2,
        "no Drive from r2 after 300 s of processor time",
    )
    machine.silence.broken()
    machine.pass_by(0.5)
    assert machine.pass_by(31.0, starting=True) == SilenceVerdict(R2, "no Drive from r2 for 30 s")


@pytest.mark.parametrize("state", ["R", "D"])
def test_who_waits_for_a_processor_or_a_disk_is_not_idle(machine: Machine, state: str) -> None:
    machine.state[WORKER] = state
    assert machine.pass_by(3600.0) is None


@pytest.mark.parametrize("pid", [11, KEEPER, WORKER])
def test_nobody_is_judged_while_anybody_of_the_run_is_stopped(machine: Machine, pid: int) -> None:
    assert machine.pass_by(25.0) is None
    machine.state[pid] = "T"
    assert machine.pass_by(3600.0) is None
    assert machine.silence.stopped == {"r1" if pid == 11 else "r2"}
    machine.state[pid] = "S"
    assert machine.pass_by(4.0) is None, "what it idled before still counts, what it was stopped does not"
    assert machine.silence.stopped == frozenset()
    assert machine.pass_by(2.0) == SilenceVerdict(R2, "no Drive from r2 for 30 s")


def test_a_suspended_computer_counts_as_two_looks(machine: Machine) -> None:
    assert machine.pass_by(28.0) is None
    assert machine.pass_by(36_000.0, every=36_000.0) is None
    assert machine.pass_by(2.0) == SilenceVerdict(R2, "no Drive from r2 for 30 s")


def test_a_step_begins_everything_anew(machine: Machine) -> None:
    for _ in range(3):
        assert machine.pass_by(29.0) is None
        machine.silence.broken()
        machine.pass_by(0.5)


def test_who_is_not_awaited_is_not_blamed(machine: Machine) -> None:
    assert machine.pass_by(29.0, working=0.5) is None
    assert machine.pass_by(29.0, working=0.5) is None, "r1 has idled all the time, and nobody waits for it"


def test_who_has_ended_is_left_to_those_who_look_at_ends(machine: Machine) -> None:
    gone = Suspect("r3", 999)
    for _ in range(20):
        machine.now_s += 0.5
        assert machine.silence.verdict((*BOTH, gone), (gone,), "no Drive from r3") is None


def test_who_waits_for_a_process_of_its_own_is_idle(machine: Machine) -> None:
    """As by vfork(2): it sleeps as if for a disk, until the child lets go of its memory."""
    machine.state |= {WORKER: "D", CHILD: "S"}
    machine.cpu_s[CHILD] = 0.0
    assert machine.pass_by(28.0) is None
    assert machine.silence.doing(R2) == "waits for a process of its own"
    assert machine.pass_by(3.0) == SilenceVerdict(R2, "no Drive from r2 for 30 s")


def test_a_process_of_its_own_that_waits_for_a_disk_is_not_idle(machine: Machine) -> None:
    machine.state |= {WORKER: "D", CHILD: "D"}
    machine.cpu_s[CHILD] = 0.0
    assert machine.pass_by(3600.0) is None
    assert machine.silence.doing(R2) == "waits for a disk"


@pytest.fixture
def telling() -> Machine:
    """It says how long a process waited for a processor."""
    machine = Machine()
    machine.queued_s = 0.0
    machine.pass_by(0.5)
    return machine


@pytest.mark.parametrize("working", [0.3, 0.5, 0.7])
def test_who_works_and_sleeps_by_turns_has_no_more_time_than_others(telling: Machine, working: float) -> None:
    assert telling.pass_by(29.5, working=working) is None
    assert telling.pass_by(1.0, working=working) == SilenceVerdict(
        R2, f"no Drive from r2 for 30 s, {30 * working:.0f} s of them processor time"
    )


def test_what_was_waited_for_a_processor_is_nobodys(telling: Machine) -> None:
    """r2 gets a tenth of a processor, and would have all of it: r2 and its keeper are told of together."""
    assert telling.queued_s is not None
    for _ in range(590):
        telling.queued_s += 0.225
        assert telling.pass_by(0.5, working=0.1) is None
    for _ in range(20):
        telling.queued_s += 0.225
        found = telling.pass_by(0.5, working=0.1)
    assert found == SilenceVerdict(R2, "no Drive from r2 after 30 s of processor time")


def test_who_holds_up_steps_is_counted_by_its_own_time(machine: Machine) -> None:
    for lasted_s in (0.5, 2.5, 2.0, 0.5):
        machine.silence.broken()
        machine.pass_by(lasted_s)
    machine.silence.broken()
    assert machine.silence.held_up == {"r2": HoldUp(2, 2.5, 4.5)}
    machine.pass_by(4.0, working=1.0)
    again = machine.silence.held_up["r2"]  # the one that lasts is among them
    assert (again.steps, round(again.most_s, 6), again.total_s) == (3, 4.0, 8.5)
    assert list(sentences(machine.silence.held_up)) == ["r2 held up 3 steps, by 4.0 s at most, 8.5 s in all."]


@pytest.mark.parametrize("state", ["R", "D", "T"])
def test_nobody_holds_up_steps_that_the_machine_holds_up(machine: Machine, state: str) -> None:
    machine.state[WORKER] = state
    for _ in range(3):
        machine.pass_by(8.0)
        machine.silence.broken()
    assert machine.silence.held_up == {}
