"""A swarm over 1, 2 and 3 hosts that are network namespaces of this computer: steps per second, by delay.

All hosts share this computer's cores, so more of them make nothing faster here: what the links cost is
measured, and what hosts with cores of their own would give follows from the parts by arithmetic.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Final

import msgspec
from rich.table import Table

from actors.console import screen
from actors.installation.repository import REPOSITORY
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes
from benchmarks.hosts.between import LISTEN, relayed
from benchmarks.hosts.cluster import ADDRESS, TlsCluster
from benchmarks.hosts.compression import CompressionFigures, compression
from benchmarks.hosts.links import HostsError
from benchmarks.hosts.namespaces import Hosts
from benchmarks.statistics.measured import Measured

HOSTS: Final = (1, 2, 3)
ROBOTS: Final = (6, 20, 60)
DELAYS_MS: Final = (0.0, 1.0, 10.0)
_SECONDS: Final = 10.0
_STEPS_PER_S: Final = 10
"""Of simulated time, in the scenario `chapter`."""
_CORES: Final = 2
"""Of each host in the arithmetic."""


@dataclass(frozen=True)
class HostedFigures:
    """One swarm on so many hosts; 0: without, all on this computer."""

    hosts: int
    robots: int
    delay_ms: float
    steps_per_s: float
    """Of wall time, from the first step to the last."""
    centre_ms: float
    """CPU of world and radio in a step, ms."""
    robot_ms: float
    """CPU of one robot in a step, ms."""
    compression: CompressionFigures | None
    """Of what a robot senses; None with hosts."""

    @property
    def step_ms(self) -> float:
        """Wall time of a step, ms."""
        return 1000 / self.steps_per_s


def measure(robots: Sequence[int] | None = None, duration: float | None = None) -> Measured:
    """Each number of robots on each number of hosts, with each delay."""
    say = screen(stderr=True)
    found: list[HostedFigures] = []
    for figures in _all(tuple(robots or ROBOTS), duration or _SECONDS):
        found.append(figures)
        say.print(
            f"{figures.robots} robots, {figures.hosts or 'no'} hosts, {figures.delay_ms:g} ms: "
            f"{figures.steps_per_s:.1f} steps/s"
        )
    rows = [asdict(one) for one in found]
    table = Table("robots", "hosts", "delay, ms", "steps/s", "step, ms", "world and radio, ms", "a robot, ms")
    for one in found:
        table.add_row(
            *(str(one.robots), str(one.hosts or "none"), f"{one.delay_ms:g}", f"{one.steps_per_s:.1f}"),
            *(f"{one.step_ms:.1f}", f"{one.centre_ms:.2f}", f"{one.robot_ms:.2f}"),
        )
    packed = [one.compression.sentence for one in found if one.compression][-1:]
    return Measured({"cores": os.cpu_count(), "swarms": rows}, (table, *_arithmetic(found), *packed))


def _all(robots: Sequence[int], seconds: float) -> Iterator[HostedFigures]:
    for count in robots:
        yield _local(count, seconds)
    for number in HOSTS:
        with (
            tempfile.TemporaryDirectory(prefix="acrc-") as name,
            Hosts(number) as hosts,
            TlsCluster(hosts, Path(name) / "cluster") as cluster,
        ):
            for delay_ms in DELAYS_MS:
                with relayed(hosts, delay_ms) if delay_ms else nullcontext():
                    for count in robots:
                        yield _hosted(hosts, cluster, count, seconds, delay_ms)


def _local(robots: int, seconds: float) -> HostedFigures:
    return _figures(0, robots, seconds, 0.0, lambda words: words, dict(os.environ), ())


def _hosted(hosts: Hosts, cluster: TlsCluster, robots: int, seconds: float, delay_ms: float) -> HostedFigures:
    where = ("--on", ADDRESS, *(LISTEN if delay_ms else ()))
    here = hosts.here.command
    return _figures(len(hosts.each), robots, seconds, delay_ms, here, cluster.environment, where)


def _figures(
    hosts: int,
    robots: int,
    seconds: float,
    delay_ms: float,
    there: Callable[[Sequence[str]], Sequence[str]],
    environment: Mapping[str, str],
    words: Sequence[str],
) -> HostedFigures:
    with tempfile.TemporaryDirectory(prefix="acrc-") as name:
        out = Path(name) / "run"
        command = [
            *(sys.executable, "-P", "-m", "command_line", "run", "--robots", str(robots), "--json"),
            *("--duration", f"{seconds:g}", "--out", str(out), *words),
        ]
        done = subprocess.run(
            there(command), cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise HostsError(f"{robots} robots on {hosts} hosts do not run: {done.stderr.strip()[-500:]}")
        steps = seconds * _STEPS_PER_S
        wall_s = float(json.loads(done.stdout)["wall_s"])
        spent = {path.stem: _spent_s(path) for path in out.glob("*/*.mcap")}
        centre = spent.pop("world") + spent.pop("radio")
        robot = median(spent.values())
        packed = None if hosts else compression(out)
        return HostedFigures(
            hosts, robots, delay_ms, steps / wall_s, 1000 * centre / steps, 1000 * robot / steps, packed
        )


def _spent_s(recording: Path) -> float:
    """CPU of an actor from its first step to its end, s."""
    note = msgspec.json.decode(read_notes(recording)["final"], type=FinalNote)
    return note.cpu_s - note.startup_cpu_s


def _arithmetic(found: Sequence[HostedFigures]) -> Iterator[str]:
    """What hosts with cores of their own would give: the centre's CPU, the robots' on each host, two ways."""
    for robots in dict.fromkeys(one.robots for one in found):
        ours = [one for one in found if one.robots == robots and one.hosts]
        centre, robot = median(one.centre_ms for one in ours), median(one.robot_ms for one in ours)
        rates = []
        for number in HOSTS:
            step_ms = centre + -(-robots // number) / _CORES * robot
            rates.append(f"{number}: {1000 / step_ms:.0f}, {1000 / (step_ms + 2):.0f} with 1 ms each way")
        yield (
            f"{robots} robots on hosts with {_CORES} cores each, world and radio on a computer of their own, "
            f"by arithmetic (steps/s): {'; '.join(rates)}"
        )
