"""Other Pythons on this processor, each with the pinned packages in an environment of its own."""

import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from actors.installation.pins import MINORS, requirements
from actors.installation.repository import SHIPPED
from benchmarks.processors.computer import Computer

_NEWEST_PINS: Final = 14
"""From here on there are newer pins of numpy, numba and llvmlite."""
_PATIENCE_S: Final = 900.0


def computers(folder: Path, wanted: Callable[[str], bool]) -> Iterator[Computer]:
    """One for each Python that is not this one, and the newest one with the packages of 3.14.

    Only what is `wanted`, by its name, is built.
    """
    found = {minor: interpreter(minor) for minor in MINORS if minor != sys.version_info.minor}
    tried = [(f"Python 3.{minor}", path, minor) for minor, path in found.items()]
    able = [minor for minor, path in found.items() if path is not None and 12 <= minor < _NEWEST_PINS]
    if able and found.get(_NEWEST_PINS) is None:
        name = f"Python 3.{max(able)}, the packages of 3.{_NEWEST_PINS}"
        tried.append((name, found[max(able)], _NEWEST_PINS))
    for name, path, minor in tried:
        if wanted(name):
            yield _computer(name, path, minor, folder)


def interpreter(minor: int) -> Path | None:
    """A Python 3.`minor` that runs: on the path, or among those that pyenv has installed."""
    name = f"python3.{minor}"
    known = sorted(Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/{name}"), reverse=True)
    on_path = shutil.which(name)
    for path in ([Path(on_path)] if on_path else []) + known:
        if subprocess.run([path, "-c", ""], capture_output=True, check=False).returncode == 0:
            return path
    return None


def pins(minor: int) -> list[str]:
    """The base's and the simulator's packages with their hashes, as they are pinned for Python 3.`minor`."""
    return requirements((SHIPPED / "constraints.txt").read_text(), minor, ("base", "sim"))


def pip(python: Path, place: Path, minor: int, *words: str) -> bool:
    """Whether that Python's pip did it with those pins; a list of them is left in the folder `place`."""
    listed = place / "pins.txt"
    listed.write_text("".join(f"{pin}\n" for pin in pins(minor)))
    common = ("--only-binary", ":all:", "--no-deps", "--require-hashes", "-r", str(listed))
    asked = [str(python), "-m", "pip", "--disable-pip-version-check", "-q", *words, *common]
    try:
        done = subprocess.run(asked, capture_output=True, check=False, timeout=_PATIENCE_S)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def _computer(name: str, path: Path | None, minor: int, folder: Path) -> Computer:
    if path is None:
        return Computer(name, missing="no such interpreter was found")
    place = folder / name.replace(" ", "-").replace(",", "")
    python = place / "bin" / "python"
    if not (place / "complete").exists():
        shutil.rmtree(place, ignore_errors=True)
        made = subprocess.run([path, "-m", "venv", place], capture_output=True, check=False)
        if made.returncode or not pip(python, place, minor, "install"):
            return Computer(name, missing="the packages could not be installed: not all have wheels for it")
        (place / "complete").touch()
    return Computer(name, (str(python),))
