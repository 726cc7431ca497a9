"""An ARM processor of 64 bits in an emulator of processes: Debian's Python with the pinned wheels.

No system is started: qemu runs one process, and what that asks of Linux this Linux answers.
"""

import os
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from benchmarks.processors.computer import Computer
from benchmarks.processors.pythons import pins
from deploy.fleet.bundle.wheels import fetch

NAME: Final = "aarch64 in qemu, Debian's Python 3.11"
PROGRAMS: Final = {
    "qemu-aarch64-static": "qemu-user-static",
    "debootstrap": "debootstrap",
    "dpkg-deb": "dpkg",
}
"""What is needed, and the Debian packages that bring it."""
_PATIENCE_S: Final = 900.0


class NotBuiltError(Exception):
    """A step that failed, in words."""


def computer(folder: Path, install: bool) -> Computer:
    """The emulated processor, built in `folder` unless it is there; `install`: missing programs too."""
    try:
        _provide(install)
        root, site = folder / "aarch64-root", folder / "aarch64-site"
        _once(root, _system)
        _once(site, _packages)
    except NotBuiltError as error:
        return Computer(NAME, missing=str(error))
    command = ("qemu-aarch64-static", "-L", str(root), str(root / "usr/bin/python3.11"))
    return Computer(NAME, command, {"PYTHONPATH": f"{site}{os.pathsep}{REPOSITORY}"})


def _provide(install: bool) -> None:
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing and install:
        _do("apt-get", "install", "-y", "--no-install-recommends", *(PROGRAMS[name] for name in missing))
        missing = [name for name in missing if shutil.which(name) is None]
    if missing:
        packages = " ".join(PROGRAMS[name] for name in missing)
        raise NotBuiltError(f"{', '.join(missing)} not found; --install, or: sudo apt install {packages}")


def _once(place: Path, build: Callable[[Path], None]) -> None:
    """Build it unless it is complete."""
    if (place / "complete").exists():
        return
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    build(place)
    (place / "complete").touch()


def _system(root: Path) -> None:
    """Debian's packages, taken apart but not set up: nothing of them is run but Python."""
    _do(
        "debootstrap",
        "--arch=arm64",
        "--foreign",
        "--variant=minbase",
        "--include=python3",
        "bookworm",
        str(root),
    )
    for package in sorted((root / "var/cache/apt/archives").glob("*.deb")):
        _do("dpkg-deb", "-x", str(package), str(root))


def _packages(site: Path) -> None:
    """The wheels of the base and the simulator, taken apart."""
    wheels = site.with_name("aarch64-wheels")
    shutil.rmtree(wheels, ignore_errors=True)
    try:
        fetch(wheels, pins(11), 11, "aarch64")
    except AcrcError as error:
        raise NotBuiltError(str(error)) from None
    for wheel in sorted(wheels.glob("*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)


def _do(*command: str) -> None:
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_PATIENCE_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NotBuiltError(f"{Path(command[0]).name} failed: {type(error).__name__}") from None
    if done.returncode:
        raise NotBuiltError(f"{Path(command[0]).name} {command[1]} failed with exit code {done.returncode}")
