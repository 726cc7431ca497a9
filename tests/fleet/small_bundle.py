"""A clone of a few small files, wheels with nothing in them, a fleet with keys: what a bundle is made of."""

import hashlib
import shutil
import zipfile
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest

from actors.robot.behaviour.foreign import Permit
from deploy.fleet import keys
from deploy.fleet.bundle import making
from deploy.fleet.bundle.making import RobotBundle
from deploy.fleet.fleet_file import load_fleet
from tests.fleet.texts import OFFICE, ROOT

PURE = "tiny-1.0-py3-none-any.whl"
NATIVE = {machine: f"native-2.0-cp312-cp312-manylinux2014_{machine}.whl" for machine in ("x86_64", "aarch64")}


def wheel(folder: Path, name: str) -> str:
    """Make a wheel of that name; its hash."""
    package, version, *_ = name.split("-")
    info = f"{package}-{version}.dist-info"
    tag = name.removesuffix(".whl").split("-", 2)[2]
    with zipfile.ZipFile(folder / name, "w") as archive:
        archive.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
        archive.writestr(f"{info}/WHEEL", f"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: {tag}\n")
        archive.writestr(f"{info}/RECORD", "")
    return hashlib.sha256((folder / name).read_bytes()).hexdigest()


class SmallClone:
    """What a bundle is made of, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.root, self.wheels, self.office = folder / "clone", folder / "wheels", folder / "office.toml"
        for name in ("actors", "deploy/__pycache__", "benchmarks", "runs", ".venv"):
            (self.root / name).mkdir(parents=True)
        self.wheels.mkdir()
        for name in ("LICENSE", "README.md", "acrc", "pyproject.toml"):
            shutil.copy(ROOT / name, self.root)
        for name in ("actors/py.typed", "actors/core.py", "benchmarks/b.py", "runs/r.py", ".venv/v.py"):
            (self.root / name).write_text("")
        (self.root / "deploy" / "__pycache__" / "old.pyc").write_text("")
        (self.root / "actors" / "link.py").symlink_to(self.root / "runs" / "r.py")
        self.office.write_text(OFFICE.read_text().replace("../maps", "maps"))
        shutil.copytree(ROOT / "maps", folder / "maps")
        native = " ".join(f"--hash=sha256:{wheel(self.wheels, one)}" for one in NATIVE.values())
        pins = f"# [build]\n\n# [base]\ntiny==1.0 --hash=sha256:{wheel(self.wheels, PURE)}\n"
        (self.root / "constraints.txt").write_text(f"{pins}\n# [hardware]\nnative==2.0 \\\n    {native}\n")

    def issue(self) -> None:
        """Make the fleet's keys."""
        fleet = load_fleet(self.office)
        keys.issue(fleet, fleet.keys, {}, now=datetime.now(UTC), days=1)

    def bundle(
        self, out: Path, robot: str = "r2", machine: str = "x86-64", python: str = "3.12"
    ) -> RobotBundle:
        """Bundle it."""
        return making.make(
            self.root, load_fleet(self.office), robot, Permit(), machine=machine, python=python, out=out
        )


def without_network(monkeypatch: pytest.MonkeyPatch, wheels: Path) -> None:
    """Pip finds what is in the folder, and nothing else."""
    for name in ("PIP_EXTRA_INDEX_URL", "PIP_INDEX_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(wheels))


def copied(wheels: Path) -> Callable[..., None]:
    """Stands for pip, which takes seconds: all wheels are fetched."""

    def fetch(place: Path, requirements: Sequence[str], minor: int, machine: str) -> None:
        for path in wheels.iterdir():
            shutil.copy(path, place)

    return fetch
