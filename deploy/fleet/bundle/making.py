"""Makes a robot's bundle: program, wheels, service, what the robot is told, and the installer."""

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.pins import MINORS, requirements
from actors.installation.repository import PACKAGES
from actors.installation.usage import OptionError, wrong_value
from actors.installation.version import COMMIT, software
from actors.processes.scratch import scratch_folder
from actors.robot.behaviour.foreign import Permit
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from deploy.fleet.bundle import archive, given
from deploy.fleet.bundle.archive import BundledFile
from deploy.fleet.bundle.wheels import MACHINES, fetch
from deploy.fleet.fleet_file import Fleet, FleetRobot
from deploy.fleet.units import service

PLACE: Final = Path("/srv/acrc")
"""On the robot: a folder of versions, and the link `current`. A sandbox would show its robot all of /opt."""
USER: Final = "acrc"
"""Who the robot runs as; the installer makes this user."""
_STATE: Final = "/var/lib/acrc/state"
"""Epochs, beside the recordings: whatever version counts them, they go on."""
_SECTIONS: Final = ("base", "hardware", "build")
_ROBOT: Final = PACKAGES - {"acrc_testbed", "benchmarks", "experiments"}
_ROOT: Final = ("LICENSE", "README.md", "acrc", "constraints.txt", "pyproject.toml")
_INSTALLER: Final = "install.sh"
_EXECUTABLE: Final = 0o755


class RobotBundle(NamedTuple):
    """What was made."""

    file: Path
    robot: str
    machine: str
    python: str
    files: int
    bytes: int
    sha256: str
    lacks: str = ""
    """What `acrc add` brought for strategies, and the bundle has not; empty for a shipped strategy."""


def make(
    root: Path, fleet: Fleet, name: str, permit: Permit, *, machine: str, python: str, out: Path
) -> RobotBundle:
    """Bundle the clone in `root` for the robot `name`, whose computer has that processor and that Python.

    The same inputs give the same bytes. Raises AcrcError or OptionError, and then makes nothing.
    """
    minor = _minor(machine, python)
    if out.is_dir():
        raise OptionError(f"--out: {out} is a folder; must be a file")
    robot = fleet.robot(name)
    given.check(fleet, robot, permit)
    told, leads = given.fleet_files(fleet, robot)
    own = given.modules(fleet, permit)
    about = {"robot": name, "machine": MACHINES[machine], "python": python}
    parts = {**_program(root), **told, **own, **_about(about), **_unit(fleet, robot, own=bool(own))}
    files = {
        _INSTALLER: _as_it_is(Path(__file__).parent / _INSTALLER),
        **{f"program/{place}": file for place, file in parts.items()},
        **_wheels((root / "constraints.txt").read_text(), minor, machine),
    }
    links = {"program/.state": _STATE, f"program/{given.FILE}": leads}
    try:
        archive.write(out, f"acrc-{name}", files, links)
        with out.open("rb") as written:
            digest = hashlib.file_digest(written, "sha256").hexdigest()
    except OSError as error:
        raise AcrcError(f"{out}: the bundle cannot be written: {error.strerror}") from None
    return RobotBundle(
        file=out,
        robot=name,
        machine=machine,
        python=python,
        files=len(files),
        bytes=out.stat().st_size,
        sha256=digest,
        lacks=_added(root) if own else "",
    )


def _minor(machine: str, python: str) -> int:
    """Of the Python. Raises OptionError for a computer that there are no wheels for."""
    if machine not in MACHINES:
        raise wrong_value("--machine", machine, " or ".join(MACHINES))
    minors = {f"3.{minor}": minor for minor in MINORS}
    if python not in minors:
        raise wrong_value("--python", python, f"one of {', '.join(minors)}")
    return minors[python]


def _about(told: Mapping[str, str]) -> dict[str, BundledFile]:
    """What the installer reads, and the commit of which the program is."""
    lines = "".join(f"{key} {value}\n" for key, value in told.items())
    return {"about": BundledFile(lines.encode()), COMMIT: BundledFile(f"{software()}\n".encode())}


def _unit(fleet: Fleet, robot: FleetRobot, *, own: bool) -> dict[str, BundledFile]:
    """The service, as `acrc fleet units` would write it for the place on the robot."""
    current = PLACE / "current"
    text = service(
        replace(fleet, path=current / given.FILE),
        robot,
        program=current / "acrc",
        user=USER,
        modules=[current / given.MODULES] if own else [],
    )
    return {f"units/acrc-{robot.id}.service": BundledFile(text.encode())}


def _added(root: Path) -> str:
    """Packages beyond the pins, which have no hashes here."""
    listed = root / "requirements.txt"
    return ", ".join(listed.read_text().split()) if listed.is_file() else ""


def _program(root: Path) -> dict[str, BundledFile]:
    """What a robot runs of the clone, as it is now."""
    paths = [*(root / name for name in _ROOT), *_sources(root)]
    return {path.relative_to(root).as_posix(): _as_it_is(path) for path in paths}


def _sources(root: Path) -> Iterator[Path]:
    for package in sorted(_ROBOT):
        for path in (root / package).rglob("*"):
            parts = path.relative_to(root).parts
            hidden = any(part == "__pycache__" or part.startswith(".") for part in parts)
            if path.is_file() and not path.is_symlink() and not hidden:
                yield path


def _as_it_is(path: Path) -> BundledFile:
    return BundledFile(regular_file.content(path), _EXECUTABLE if os.access(path, os.X_OK) else 0o644)


def _wheels(constraints: str, minor: int, machine: str) -> dict[str, BundledFile]:
    with scratch_folder() as folder:
        fetch(folder, requirements(constraints, minor, _SECTIONS), minor, machine)
        return {f"wheels/{path.name}": BundledFile(path.read_bytes()) for path in folder.glob("*.whl")}
