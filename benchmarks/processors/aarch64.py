"""An ARM processor of 64 bits in an emulator of processes: Debian's Python with the pinned wheels.

No system is started: qemu runs one process, and what that asks of Linux this Linux answers.
"""

import os
import shutil
import sys
import zipfile
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from benchmarks.processors.building import NotBuiltError, do, once, provide
from benchmarks.processors.computer import Computer
from benchmarks.processors.pythons import pip

NAME: Final = "aarch64 in qemu, Debian's Python 3.11"
PROGRAMS: Final = {
    "qemu-aarch64-static": "qemu-user-static",
    "debootstrap": "debootstrap",
    "dpkg-deb": "dpkg",
}
"""What is needed, and the Debian packages that bring it."""
_PLATFORMS: Final = ("manylinux2014", "manylinux_2_17", "manylinux_2_26", "manylinux_2_27", "manylinux_2_28")


def computer(folder: Path, install: bool) -> Computer:
    """The emulated processor, built in `folder` unless it is there; `install`: missing programs too."""
    try:
        provide(PROGRAMS, install)
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
    wheels, installer = site.with_name("aarch64-wheels"), site.with_name("installer")
    shutil.rmtree(wheels, ignore_errors=True)
    do(sys.executable, "-m", "venv", "--clear", str(installer))
    platforms = [
        word for name in (*(f"{p}_aarch64" for p in _PLATFORMS), "any") for word in ("--platform", name)
    ]
    wanted = ("--python-version", "3.11", *platforms, "-d", str(wheels))
    if not pip(installer / "bin" / "python", site, 11, "download", *wanted):
        raise NotBuiltError("the wheels for aarch64 could not be fetched")
    for wheel in sorted(wheels.glob("*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
