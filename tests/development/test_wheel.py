"""The wheel is complete and runs in any folder of a machine without a clone."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from actors.installation import usage
from actors.installation.repository import PACKAGES, REPOSITORY
from tests.development.budget import committed

BUILD = """
import os, sys
from setuptools import build_meta
os.chdir(sys.argv[1])
build_meta.build_wheel(sys.argv[2])
"""
SHIPPED = "actors/installation/shipped"
DATA = ("maps", "scenarios", "studies", "fleets")


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the clone's files, since setuptools writes beside them."""
    sources = tmp_path_factory.mktemp("sources")
    for name in committed():
        if name.parts[0] in {*PACKAGES, *DATA, "distributions"} or len(name.parts) == 1:
            (sources / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(REPOSITORY / name, sources / name, follow_symlinks=False)
    return sources


def build(project: Path, out: Path) -> Path:
    """Build a wheel without a network."""
    subprocess.run([sys.executable, "-P", "-c", BUILD, project, out], check=True, capture_output=True)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def wheel(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(sources, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def python(wheel: Path, sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    site = folder / "lib" / version / "site-packages"
    deeco = build(sources / "distributions" / "deeco", tmp_path_factory.mktemp("deeco"))
    for file in (wheel, deeco):
        with zipfile.ZipFile(file) as archive:
            archive.extractall(site)
    # .pth files of the clone's environment have no effect there
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin" / "python"


def acrc(python: Path, folder: Path, *words: str, path: str = "") -> subprocess.CompletedProcess[str]:
    command = [str(python), "-P", "-m", "acrc_testbed.command_line", *words]
    env = os.environ | {"PYTHONPATH": path}  # not the tests' own, which contains the clone
    return subprocess.run(
        command, cwd=folder, env=env, capture_output=True, text=True, check=False, timeout=600
    )


def test_the_wheel_has_every_file_of_the_packages_and_the_data(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}
    packages = PACKAGES - {"deeco"}  # a distribution of its own
    wanted = {
        f"{SHIPPED}/{name}" if name.parts[0] in {*DATA, "constraints.txt"} else name.as_posix()
        for name in committed()
        if name.parts[0] in {*packages, *DATA, "constraints.txt"} and not name.is_relative_to(SHIPPED)
    }
    assert set(held) == wanted
    for name, content in held.items():
        assert content == (REPOSITORY / name.removeprefix(f"{SHIPPED}/")).read_bytes(), name


@pytest.mark.nightly
def test_scenarios_are_found_and_missing_parts_are_named(python: Path, tmp_path: Path) -> None:
    listed = json.loads(acrc(python, tmp_path, "list", "scenarios", "--json").stdout)
    assert {row["name"] for row in listed} == {path.stem for path in (REPOSITORY / "scenarios").iterdir()}
    assert all((tmp_path / row["path"]).is_file() for row in listed)
    site = next((python.parents[1] / "lib").glob("python*")) / "site-packages"
    for command in ("test", "check", "docs"):
        done = acrc(python, tmp_path, command)
        assert done.returncode == 1
        assert done.stderr == f"acrc: {command}: requires a clone of the repository (got a wheel in {site})\n"
    (tmp_path / "absent").mkdir()
    (tmp_path / "absent" / "sitecustomize.py").write_text("import sys\nsys.modules['scipy.stats'] = None\n")
    done = acrc(python, tmp_path, "study", "plan", path=str(tmp_path / "absent"))
    assert (done.returncode, done.stderr) == (
        1, "acrc: Python package scipy.stats is not installed; install it with: pip install "
        "'acrc-testbed[experiments]'\n"
    )  # fmt: skip


def test_every_package_of_an_extra_has_its_name() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    imported = {"pyserial": "serial", "rerun-sdk": "rerun"}
    named = {
        Requirement(one).name: extra
        for extra, packages in project["optional-dependencies"].items()
        for one in packages
        if extra not in {"dev", "docs"}  # these need a clone
    }
    assert {imported.get(name, name): extra for name, extra in named.items()} == usage._EXTRAS


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_a_run_of_the_wheel_is_that_of_the_clone(python: Path, tmp_path: Path) -> None:
    """Run nightly, since every kernel is compiled for the new location."""
    words = ("run", "--robots", "2", "--seed", "1", "--duration", "5", "--json")
    done = acrc(python, tmp_path, *words, "--out", "of_the_wheel")
    assert done.returncode == 0, done.stderr
    here = subprocess.run(
        [sys.executable, "-P", "-m", "acrc_testbed.command_line", *words, "--out", "of_the_clone"],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    of_the_wheel, of_the_clone = json.loads(done.stdout), json.loads(here.stdout)
    assert of_the_wheel["digest"] == of_the_clone["digest"]
    assert of_the_wheel["isolation"] == of_the_clone["isolation"]
    assert acrc(python, tmp_path, "replay", "of_the_wheel").stdout.startswith("matches the recording: ")
