"""Systems built with Debian's programs: what is missing, what is there already, and which step has failed."""

import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

_PATIENCE_S: Final = 900.0


class NotBuiltError(Exception):
    """A step that failed, in words."""


def provide(programs: Mapping[str, str], install: bool) -> None:
    """Raise NotBuiltError unless all are there; by program, the Debian package that brings it.

    `install`: let apt-get install what is missing.
    """
    missing = [name for name in programs if shutil.which(name) is None]
    if missing and install:
        do("apt-get", "install", "-y", "--no-install-recommends", *(programs[name] for name in missing))
        missing = [name for name in missing if shutil.which(name) is None]
    if missing:
        packages = " ".join(programs[name] for name in missing)
        raise NotBuiltError(f"{', '.join(missing)} not found; --install, or: sudo apt install {packages}")


def once(place: Path, build: Callable[[Path], None]) -> None:
    """Build it unless it is complete."""
    if (place / "complete").exists():
        return
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    build(place)
    (place / "complete").touch()


def do(*command: str) -> None:
    """Run it. Raises NotBuiltError where it fails."""
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=_PATIENCE_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NotBuiltError(f"{Path(command[0]).name} failed: {type(error).__name__}") from None
    if done.returncode:
        raise NotBuiltError(f"{Path(command[0]).name} {command[1]} failed with exit code {done.returncode}")
