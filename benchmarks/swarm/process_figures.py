"""What Linux tells of a run's processes while they live: memory, system time, context switches."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

PROC: Final = Path("/proc")
KINDS: Final = ("world", "radio", "robots")
"""World and radio are one process each, and have its name."""
_TICK_S: Final = 1 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Memory:
    """Of all processes of one kind together, MB."""

    processes: int
    rss_mb: float
    """Resident; pages that several processes share count in each."""
    pss_mb: float
    """Proportional: a page that n processes share counts 1/n in each."""
    private_mb: float
    """Pages that no other process has."""


@dataclass(frozen=True)
class Activity:
    """Of one or more processes, since their start."""

    user_s: float
    system_s: float
    switches: int
    """Context switches of all their threads."""


def kind(actor: str) -> str:
    """The kind of process that the actor of that name is."""
    return actor if actor in KINDS else KINDS[-1]


def actors_of(out: Path) -> dict[str, list[int]]:
    """The process ids of a run by kind; an actor is known by the log it writes to."""
    pids: dict[str, list[int]] = {name: [] for name in KINDS}
    for entry in PROC.iterdir():
        if not entry.name.isdecimal():
            continue
        try:
            log = (entry / "fd" / "1").readlink()
        except OSError:  # it has ended, or is not ours
            continue
        if log.parent.parent == out:
            pids[kind(log.stem)].append(int(entry.name))
    return pids


def parent_of(pid: int) -> int:
    """The process that started it."""
    return int(_stat(pid)[1])


def memory(pids: Sequence[int]) -> Memory:
    """The memory of these processes now."""
    sizes = [_sizes((PROC / str(pid) / "smaps_rollup").read_text()) for pid in pids]
    return Memory(len(pids), *(sum(size[index] for size in sizes) for index in range(3)))


def _sizes(text: str) -> tuple[float, float, float]:
    """RSS, PSS and private memory, MB, in a file smaps_rollup (proc_pid_smaps(5))."""
    rows = (line.split() for line in text.splitlines()[1:])
    kib = {row[0].removesuffix(":"): int(row[1]) for row in rows}
    private = kib["Private_Clean"] + kib["Private_Dirty"]
    return kib["Rss"] / 1024, kib["Pss"] / 1024, private / 1024


def activity(pids: Sequence[int]) -> Activity:
    """What these processes have done so far."""
    user = system = switches = 0
    for pid in pids:
        fields = _stat(pid)
        user, system = user + int(fields[11]), system + int(fields[12])
        switches += sum(_switches(task) for task in (PROC / str(pid) / "task").iterdir())
    return Activity(user * _TICK_S, system * _TICK_S, switches)


def _stat(pid: int) -> list[str]:
    """The fields of proc_pid_stat(5) after the name, which may contain anything."""
    return (PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()


def _switches(task: Path) -> int:
    lines = (task / "status").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if "ctxt_switches" in line)


class Load:
    """How busy the machine is beside what is measured."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._began, self._busy = clock(), _busy_s()

    def others(self, own_s: float) -> float:
        """Cores that were busy with anything else since the start, if we have used `own_s` CPU seconds."""
        return max(0.0, (_busy_s() - self._busy - own_s) / (self._clock() - self._began))


def _busy_s() -> float:
    """CPU time of the whole machine that was not idle, since it started (proc_stat(5)), s."""
    user, nice, system, _, _, irq, softirq, steal = map(
        int, (PROC / "stat").read_text().split("\n", 1)[0].split()[1:9]
    )
    return (user + nice + system + irq + softirq + steal) * _TICK_S


def rates(before: Mapping[str, Activity], after: Mapping[str, Activity]) -> dict[str, tuple[float, float]]:
    """By kind: the share of system time, and context switches per ms of CPU time, in between."""
    found = {}
    for kind, now in after.items():
        then = before[kind]
        user, system = now.user_s - then.user_s, now.system_s - then.system_s
        cpu = user + system
        found[kind] = (system / cpu, (now.switches - then.switches) / cpu / 1e3) if cpu else (0.0, 0.0)
    return found
