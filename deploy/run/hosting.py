"""A run whose robots are on other computers: what it asks of them, and what it tells them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from actors.processes.launch import Launcher
from actors.runtime.access.credentials import Gate
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import code_entries, unseen
from deploy.hosts.hosted_launcher import HostedLauncher
from deploy.hosts.listening import place_of
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan, in_common

if TYPE_CHECKING:  # what finds a cluster needs an extra that a run on one computer does not
    from deploy.hosts.hosts import RunHosts, SharedErrand

KEYS: Final = "keys"
"""Folder with this computer's keys of the run, in the world's."""
_MOST_CODE: Final = 64 << 20
"""Bytes of a strategy's code that a host is sent."""


@contextmanager
def recruits(options: RunOptions) -> Iterator["RunHosts | None"]:
    """The computers that are to have the robots, if the options want any. Raises AcrcError."""
    if not options.on:
        yield None
        return
    from deploy.hosts.hosts import recruited  # noqa: PLC0415

    with recruited(options.on, place_of(options.listen) if options.listen else None) as hosts:
        yield hosts


@dataclass(frozen=True)
class Away:
    """The hosts of a run that has been laid out."""

    plan: RunPlan
    hosts: "RunHosts"
    shared: "SharedErrand"

    @property
    def gate(self) -> Gate:
        """Where they connect to the mesh."""
        return self.hosts.gate

    @property
    def sentence(self) -> str:
        """Who is where, and whose clock differs."""
        return self.hosts.sentence

    def launcher(self, here: Launcher, say: Callable[[str], None]) -> HostedLauncher:
        """Starts robots there, all else here."""
        return self.hosts.launcher(here, self.shared.timeout_s, say)

    def join(self, look: Callable[[], None], wait: Callable[[float], None]) -> None:
        """Have all of them in the mesh. Raises AcrcError."""
        self.hosts.join(self.plan.out, self.shared, look, wait)

    def dismiss(self, wait: Callable[[float], None]) -> None:
        """Take what they still have, and let them go."""
        self.hosts.dismiss(wait)


def summoned(plan: RunPlan, hosts: "RunHosts", spawn: str) -> Away:
    """Place the robots, and have their hosts begin to come. Raises AcrcError."""
    from deploy.hosts.hosts import SharedErrand  # noqa: PLC0415

    hosts.place([robot.id for robot in plan.world.robots])
    shared = SharedErrand(
        spawn=spawn,
        isolate=plan.isolate,
        limits=plan.options.limits,
        timeout_s=plan.timeout.step_s,
        share=lambda robots: tuple(in_common(plan, Path(), robots)),
        code=tuple(tuple(_code(folder, plan.options.hidden)) for folder in plan.options.modules),
    )
    hosts.summon(plan.out, plan.folder("world").resolve() / KEYS, shared)
    return Away(plan, hosts, shared)


def _code(folder: Path, hidden: tuple[Path, ...]) -> Iterator[tuple[str, Path]]:
    """The files of a folder with a strategy's code, as far as a robot may see them. Raises AcrcError."""
    left = _MOST_CODE
    for entry in code_entries(folder.absolute(), unseen(hidden)):
        for path in sorted(entry.rglob("*")) if entry.is_dir() else [entry]:
            if path.is_file() and not path.is_symlink() and "__pycache__" not in path.parts:
                left -= path.stat().st_size
                if left < 0:
                    raise AcrcError(
                        f"--modules: {folder}: has more than {_MOST_CODE >> 20} MiB of files for hosts; "
                        "must be a folder with a strategy's code alone"
                    )
                yield path.relative_to(folder.absolute()).as_posix(), path
