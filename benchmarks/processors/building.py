"""What emulators and systems are built with: programs of Debian's packages, step by step, once."""

import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

_PATIENCE_S: Final = 1800.0


class NotBuiltError(Exception):
    """A step that failed, in words."""


def provide(programs: Mapping[str, str], *, install: bool) -> None:
    """Raise NotBuiltError if one is missing; `programs`: with their Debian packages, which `install` adds."""
    missing = [name for name in programs if shutil.which(name) is None]
    if missing and install:
        do("apt-get", "install", "-y", "--no-install-recommends", *(programs[name] for name in missing))
        missing = [name for name in missing if shutil.which(name) is None]
    if missing:
        packages = " ".join(programs[name] for name in missing)
        raise NotBuiltError(f"{', '.join(missing)} not found; --install, or: sudo apt install {packages}")


def once(place: Path, build: Callable[[Path], object]) -> None:
    """Build it in the folder `place` unless it is complete there."""
    complete = place.with_name(f"{place.name}.complete")
    if complete.exists():
        return
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    build(place)
    complete.touch()


def do(*command: str) -> str:
    """What a command says on both streams. Raises NotBuiltError where it fails."""
    name = Path(command[0]).name
    try:
        done = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
            timeout=_PATIENCE_S,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NotBuiltError(f"{name} failed: {type(error).__name__}") from None
    if done.returncode:
        last = (done.stdout.strip().splitlines() or ["without a word"])[-1]
        raise NotBuiltError(f"{name} {command[1]} failed with exit code {done.returncode}: {last}")
    return done.stdout
