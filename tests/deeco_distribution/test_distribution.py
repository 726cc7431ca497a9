"""The distribution `deeco`: complete, and usable where only msgpack is installed."""

import os
import re
import shutil
import socket
import subprocess
import sys
import tarfile
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from actors.installation.repository import REPOSITORY
from tests.development.budget import committed

BUILD = """
import os, sys
from setuptools import build_meta
os.chdir(sys.argv[1])
build_meta.build_sdist(sys.argv[2])
"""
WHEEL = BUILD.replace("sdist", "wheel")
PARTS = ("deeco", "distributions", "examples", "tests/deeco", "tests/__init__.py", "docs/deeco.md", "LICENSE")
README = (REPOSITORY / "distributions/deeco/README.md").read_text("utf-8")
LAPTOPS, TEST = re.findall(r"^```python\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def build(program: str, folder: Path, out: Path) -> Path:
    """Build without a network, as `pip wheel --no-build-isolation` does; return the only file."""
    out.mkdir()
    subprocess.run([sys.executable, "-P", "-c", program, folder, out], check=True, capture_output=True)
    (built,) = out.iterdir()
    return built


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the unpacked source distribution, built from a copy, since setuptools writes there."""
    folder = tmp_path_factory.mktemp("sources")
    for name in (one for one in committed() if one.as_posix().startswith(PARTS)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / name, folder / name, follow_symlinks=False)
    with tarfile.open(build(BUILD, folder / "distributions/deeco", folder / "out")) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return unpacked


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(WHEEL, source, tmp_path_factory.mktemp("wheel") / "out")


def environment(wheel: Path, folder: Path, *packages: str) -> Path:
    """Create an environment with the wheel and copies of these packages; return its Python."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    site = folder / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    todo, done = list(packages), set[str]()
    while todo:
        name = todo.pop()
        if name not in done:
            done.add(name)
            for file in metadata.files(name) or ():
                if ".." not in file.parts and "__pycache__" not in file.parts:
                    (site / file).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy(Path(str(file.locate())), site / file)
            needed = [Requirement(one) for one in metadata.requires(name) or ()]
            todo += [one.name for one in needed if one.marker is None or one.marker.evaluate({"extra": ""})]
    return folder / "bin" / "python"


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return environment(wheel, tmp_path_factory.mktemp("bare"), "msgpack")


def start(python: Path, folder: Path, *words: str) -> subprocess.Popen[str]:
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # leads to the clone
    return subprocess.Popen(
        [str(python), *words],
        cwd=folder,
        env=env,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


def output(python: Path, folder: Path, *words: str) -> str:
    process = start(python, folder, *words)
    text, _ = process.communicate(timeout=100)
    assert process.returncode == 0, text
    return text


def test_the_wheel_has_the_package_and_its_only_dependency_is_msgpack(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    (folder,) = {name.split("/")[0] for name in held if ".dist-info/" in name}
    package = {name: content for name, content in held.items() if not name.startswith(folder)}
    assert set(package) == {name.as_posix() for name in committed("deeco")}
    assert all(content == (REPOSITORY / name).read_bytes() for name, content in package.items())
    assert "deeco/py.typed" in package
    described = held[f"{folder}/METADATA"].decode()
    needed = re.findall(r"^Requires-Dist: (.*)$", described, re.MULTILINE)
    assert [one for one in needed if "extra" not in one] == ["msgpack>=1"]
    assert README in described and f"{folder}/licenses/LICENSE" in held
    version = re.findall(r"^Version: (.*)$", described, re.MULTILINE)[0]
    changes = (REPOSITORY / "distributions/deeco/CHANGELOG.md").read_text("utf-8")
    assert re.findall(r"^## (.*)$", changes, re.MULTILINE)[0] == version


@pytest.mark.nightly
def test_the_source_distribution_has_pages_examples_and_tests(source: Path) -> None:
    held = {path.relative_to(source).as_posix() for path in source.rglob("*") if path.is_file()}
    examples = {name for name in held if name.startswith("examples/")}
    names = ("__init__", "cleaning_robots", "convoy", "drones", "firefighters", "parking")
    assert examples == {f"examples/{name}.py" for name in names}
    assert {name.as_posix() for name in committed("deeco", "tests/deeco")} <= held
    assert {"README.md", "CHANGELOG.md", "LICENSE", "docs/deeco.md", "pyproject.toml"} <= held


@pytest.mark.nightly
def test_examples_and_explanations_run_where_only_msgpack_is_installed(python: Path, source: Path) -> None:
    folder = source / "examples"
    listed = "from importlib import metadata; print(sorted(one.name for one in metadata.distributions()))"
    assert output(python, folder, "-P", "-c", listed) == "['deeco', 'msgpack']\n"
    where = output(python, folder, "-P", "-c", "import deeco; print(deeco.__file__)")
    assert Path(where.strip()).is_relative_to(python.parents[1])
    for name, last in (
        ("cleaning_robots", "30 s:  -1.0 m → -1 m   9.0 m → 9 m"),
        ("convoy", " 120 s     20.0 m     20.0 m     20.0 m"),
        ("firefighters", "60 s: {'ann': 'low oxygen', 'bob': 'lost at 35 s', 'eve': 'flashover'}"),
        ("parking", "60 s: {'near': ('c',), 'far': ()}"),
    ):
        assert output(python, folder, "-P", f"{name}.py").splitlines()[-1] == last
    explained = output(python, source, "-m", "deeco.explain", "examples.firefighters")
    assert "recent: the last 5 values of celsius" in explained and "at_coordinator_end" in explained


@pytest.mark.nightly
def test_the_two_computers_of_the_readme_exchange_knowledge(python: Path, tmp_path: Path) -> None:
    (tmp_path / "two_laptops.py").write_text(LAPTOPS)
    with socket.socket(type=socket.SOCK_DGRAM) as first, socket.socket(type=socket.SOCK_DGRAM) as second:
        first.bind(("127.0.0.1", 0))
        second.bind(("127.0.0.1", 0))
        ports = [one.getsockname()[1] for one in (first, second)]
    pairs = (("ann", ports[0], ports[1]), ("bob", ports[1], ports[0]))
    running = [
        start(python, tmp_path, "two_laptops.py", name, str(own), f"127.0.0.1:{other}")
        for name, own, other in pairs
    ]
    try:
        lines = [one.stdout.readline() for one in running if one.stdout]  # the timeout of the test applies
    finally:
        for one in running:
            one.kill()
            one.communicate()
    assert lines == [
        "ann receives LaptopInfo(id='bob', battery=1.0)\n",
        "bob receives LaptopInfo(id='ann', battery=1.0)\n",
    ]


@pytest.mark.nightly
def test_the_test_of_the_readme_passes(python: Path, tmp_path: Path) -> None:
    (tmp_path / "test_fan.py").write_text(TEST + "\n\ntest_the_fan_switches_off_without_news()\n")
    assert output(python, tmp_path, "test_fan.py") == ""


@pytest.mark.nightly
@pytest.mark.timeout(300)
def test_the_tests_pass_where_only_their_packages_and_msgpack_are_installed(
    wheel: Path, source: Path, tmp_path: Path
) -> None:
    python = environment(wheel, tmp_path / "environment", "msgpack", "cryptography", "pytest", "hypothesis")
    shutil.copytree(source, tmp_path / "source", ignore=shutil.ignore_patterns("deeco.egg-info"))
    shutil.rmtree(tmp_path / "source" / "deeco")  # the tests use the installed package
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not nightly")
    text = output(python, tmp_path / "source", *words)
    assert re.search(r"^\d{3} passed", text.splitlines()[-1]), text
