"""An ARM processor of 64 bits in an emulator of processes: Debian's Python with the pinned wheels.

No system is started: qemu runs one process, and what that asks of Linux this Linux answers.
"""

import os
import shutil
import zipfile
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from benchmarks.processors.building import NotBuiltError, do, once, provide
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


def computer(folder: Path, install: bool) -> Computer:
    """The emulated processor, built in `folder` unless it is there; `install`: missing programs too."""
    try:
        provide(PROGRAMS, install=install)
        root, site = folder / "aarch64-root", folder / "aarch64-site"
        once(root, _system)
        once(site, _packages)
    except NotBuiltError as error:
        return Computer(NAME, missing=str(error))
    command = ("qemu-aarch64-static", "-L", str(root), str(root / "usr/bin/python3.11"))
    return Computer(NAME, command, {"PYTHONPATH": f"{site}{os.pathsep}{REPOSITORY}"})


def _system(root: Path) -> None:
    """Debian's packages, taken apart but not set up: nothing of them is run but Python."""
    do(
        "debootstrap",
        "--arch=arm64",
        "--foreign",
        "--variant=minbase",
        "--include=python3",
        "bookworm",
        str(root),
    )
    for package in sorted((root / "var/cache/apt/archives").glob("*.deb")):
        do("dpkg-deb", "-x", str(package), str(root))


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
