"""A run whose robots are on other computers: which these are, and what they are told."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import code_entries, unseen
from deploy.hosts.channel import place_of
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan, in_common

if TYPE_CHECKING:  # what finds a cluster needs an extra that a run on one computer does not
    from deploy.hosts.run_hosts import Recruits, RunHosts

_KEYS: Final = "keys"
"""Folder with this computer's keys of the run, in the world's."""
_MOST_CODE: Final = 64 << 20
"""Bytes of a strategy's code that a host is sent."""


@contextmanager
def allocated_hosts(options: RunOptions) -> Iterator["Recruits | None"]:
    """The computers that are to have the robots, if the options want any. Raises AcrcError."""
    if not options.on:
        yield None
        return
    from deploy.hosts.run_hosts import recruited  # noqa: PLC0415

    with recruited(options.on, place_of(options.listen) if options.listen else None) as found:
        yield found


@contextmanager
def hosts_of(plan: RunPlan, found: "Recruits | None") -> Iterator["RunHosts | None"]:
    """The hosts of a run that is laid out, on their way; None: the robots are here. Raises AcrcError."""
    if found is None:
        yield None
        return
    from deploy.hosts.run_hosts import (  # noqa: PLC0415
        RunHosts,
        SharedErrand,
        shares,
    )

    robots = [robot.id for robot in plan.world.robots]
    placed = shares(robots, {name: offer.cores for name, offer in found.offers.items()})
    shared = SharedErrand(
        out=plan.out,
        spawn=plan.options.spawn,
        limits=plan.options.limits,
        timeout_s=plan.timeout.step_s,
        share=lambda some: tuple(in_common(plan, Path(), some)),
        leave=plan.options.leave,
        code=tuple(tuple(_code(folder, plan.options.hidden)) for folder in plan.options.modules),
    )
    away = RunHosts(found, placed, plan.folder("world").resolve() / _KEYS, shared)
    try:
        yield away
    finally:
        away.close()


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
