"""One digest on all processors and Python versions: disabled instructions, other Pythons, aarch64."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import pytest

from actors.installation.repository import REPOSITORY
from actors.installation.version import MINORS, requirements
from actors.runtime.process import RunNote
from actors.runtime.recording import read_notes
from deploy.fleet.robot_bundle import download
from tests.swarm.command import run

TASK: Final = ("scenarios/corridor.toml", "--bus", "memory", "--robots", "3", "--duration", "6")
"""Robots scan, localise, drive and communicate."""
NO_FMA: Final = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX2_Usable,-FMA,-FMA_Usable,-AVX512F"}
"""Makes glibc use its functions for older processors."""
GENERIC: Final = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
"""Makes numba compile for any processor of the architecture."""


def without_widest_instructions() -> Mapping[str, str]:
    """Return settings that disable numpy's AVX-512; on a processor without it, all that numpy selects."""
    umath = np._core._multiarray_umath  # type: ignore[attr-defined]
    present = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)]
    wide = [name for name in present if name.startswith(("AVX512", "X86_V4"))]
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(wide or present)}


def kernels(out: Path) -> dict[str, dict[str, str]]:
    notes = {path.stem: read_notes(path)["run"] for path in sorted(out.glob("*/*.mcap"))}
    return {actor: msgspec.json.decode(note, type=RunNote).kernels for actor, note in notes.items()}


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    out = tmp_path_factory.mktemp("as-it-is") / "out"
    return out, run(out, *TASK)


@pytest.mark.claim("processors")
@pytest.mark.parametrize("without", ["widest instructions in numpy", "AVX2 and FMA in glibc"])
def test_one_digest_with_disabled_instructions(
    without: str, reference: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    environment = NO_FMA if "glibc" in without else without_widest_instructions()
    assert all(environment.values()), "numpy selects no instructions on this processor"
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    found = run(tmp_path / "out", *TASK)
    first, expected = reference
    assert expected["frames"]["copies_heard"] > 0 and "actors.world.physics" in kernels(first)["world"]
    assert kernels(tmp_path / "out") == kernels(first)
    assert found["digest"] == expected["digest"]


COMPILE: Final = """
from actors.kernels import load_numba
from actors.processes.kernel_compilation import compile_kernels
load_numba().unpack_kernels = set
compile_kernels()
"""
"""Compiles all kernels for this processor instead of using the machine code in the repository."""


def digest(folder: Path, python: list[str], seconds: str, *, compiled: bool, **environment: str) -> str:
    """Return the digest of a run by another interpreter; `compiled`: with kernels for this processor."""
    words = [*TASK[:-1], seconds, "--out", str(folder / "out"), "--json"]
    ours = {"PYTHONPATH": str(REPOSITORY), "NUMBA_CACHE_DIR": str(folder / "kernels")}
    call = partial(
        subprocess.run, cwd=REPOSITORY, capture_output=True, text=True,
        env={**os.environ, **ours, **environment},
    )  # fmt: skip
    if compiled:
        call([*python, "-c", COMPILE], check=True)
    done = call([*python, "-m", "acrc_testbed.command_line", "run", *words])
    assert done.returncode == 0, done.stderr
    return str(json.loads(done.stdout)["digest"])


def pinned(minor: int) -> list[str]:
    return requirements((REPOSITORY / "constraints.txt").read_text(), minor, ("base", "sim"))


@pytest.fixture(scope="module")
def seconds(request: pytest.FixtureRequest) -> str:
    return "120" if request.config.getoption("--full") else "6"


@pytest.mark.claim("processors")
@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("computer", ["generic", *(f"3.{minor}" for minor in MINORS), "aarch64"])
def test_one_digest_on_other_pythons_and_on_an_emulated_processor(
    computer: str, seconds: str, tmp_path: Path
) -> None:
    environment: dict[str, str] = {}
    python = [sys.executable]
    if computer == "generic":
        environment = {**GENERIC, **NO_FMA, **without_widest_instructions()}
    elif computer == "aarch64":
        python, environment = aarch64(tmp_path)
    else:
        python = other_python(computer, tmp_path)
    mine, other = tmp_path / "mine", tmp_path / "other"
    expected = digest(mine, [sys.executable], seconds, compiled=True)
    assert digest(other, python, seconds, compiled=False, **environment) == expected
    if computer.startswith("3."):
        assert digest(tmp_path / "compiled", python, seconds, compiled=True) == expected


def other_python(version: str, folder: Path) -> list[str]:
    python = shutil.which(f"python{version}")
    if python is None or subprocess.run([python, "-c", ""], check=False, capture_output=True).returncode:
        pytest.skip(f"needs Python {version}")
    (folder / "pins.txt").write_text("\n".join(pinned(int(version.removeprefix("3.")))))
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    made = str(folder / "venv" / "bin" / "python")
    options = ("--only-binary", ":all:", "--no-deps", "--require-hashes", "-r", folder / "pins.txt")
    subprocess.run([made, "-m", "pip", "-q", "install", *options], check=True)
    return [made]


def aarch64(folder: Path) -> tuple[list[str], dict[str, str]]:
    """Unpack Debian's Python and the pinned wheels for aarch64, to be run by qemu."""
    if os.geteuid() or not all(map(shutil.which, ("qemu-aarch64-static", "debootstrap"))):
        pytest.skip("needs root, qemu-user-static and debootstrap")
    root, wheels, site = folder / "root", folder / "wheels", folder / "site"
    words = ("--arch=arm64", "--foreign", "--variant=minbase", "--include=python3", "bookworm")
    subprocess.run(["debootstrap", *words, root], check=True)
    for package in sorted(root.glob("var/cache/apt/archives/*.deb")):
        subprocess.run(["dpkg-deb", "-x", package, root], check=True)
    download(wheels, pinned(11), "aarch64", "3.11")
    for wheel in sorted(wheels.glob("*.whl")):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
    python = ["qemu-aarch64-static", "-L", str(root), str(root / "usr/bin/python3.11")]
    return python, {"PYTHONPATH": f"{site}{os.pathsep}{REPOSITORY}"}
