"""The script `./acrc`, run with a fake python3 that records its arguments: no network, no installation."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = (
    *("sh", "cat", "cksum", "cp", "cut", "date", "dirname", "du", "env", "grep", "awk", "ln", "mkdir"),
    *("mv", "readlink", "rm", "sed", "sleep", "sort", "tr", "wc"),
)
NEEDED = "but Python 3.11 or newer with venv is required; on Debian or Ubuntu: sudo apt install"

EXTRAS = {
    "record check out": "",
    "replay out --robot r1": "sim",
    "record plot out": "pictures",
    "export out": "experiments sim",
    "export out --mcap ros2": "logs sim",
    "verify radio causes": "cluster dev experiments hardware pictures sim",
    "verify radio --data rows": "experiments sim",
    "bench radio": "hardware pictures sim",
    "bench beside HEAD": "experiments sim",
    "fleet doctor": "",
    "fleet doctor fleets/office.toml --robot r1": "",
    f"fleet doctor {ROOT}/fleets/turtlebot4.toml --robot r1": "logs",
    f"fleet onboard {ROOT}/fleets/turtlebot4.toml --robot r1": "hardware logs",
    "fleet watch tls/r1:7447": "",
    "run --on tls://h:1": "cluster hardware sim",
    "view out": "observe sim",
    "view out --png": "pictures",
    "campaign --help": "",
    "run --view --help": "",
    "check": "cluster control dev docs experiments hardware logs observe pictures sim",
    "test": "cluster control dev docs experiments hardware logs pictures sim",
    "fleet onboard f.toml --robot r1": "hardware",
    "run s.toml --hardware-in-the-loop": "hardware sim",
}
"""Extras that `./acrc` installs for a command."""


def extras_of(commands: Iterable[str]) -> dict[str, str]:
    text = (ROOT / "acrc").read_text()
    body = re.search(r"^given\(\) .*?^extras_for\(\) .*?^\}$", text, re.MULTILINE | re.DOTALL)
    assert body is not None
    names = list(commands)
    calls = "".join(f"\nextras_for {name}; echo ." for name in names)
    done = subprocess.run(["sh", "-c", body[0] + calls], capture_output=True, text=True, check=True)
    answers = (" ".join(sorted(set(lines.split()))) for lines in done.stdout.split(".\n"))
    return dict(zip(names, answers, strict=False))


@dataclass
class Clone:
    """A fresh clone in its own folder, and a PATH with only a few tools."""

    folder: Path
    tools: Path
    settings: dict[str, str] = field(default_factory=dict)

    @property
    def notes(self) -> Path:
        return self.tools.parent / "notes"

    def start(
        self, *arguments: str, script: Path | None = None, cwd: Path | None = None
    ) -> "subprocess.Popen[str]":
        fake = {"FAKE": str(self.tools / "python3"), "REAL": sys.executable, "NOTES": str(self.notes)}
        return subprocess.Popen(
            [script or self.folder / "acrc", *arguments],
            cwd=cwd or self.folder,
            env={"PATH": str(self.tools), **fake, **self.settings},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def call(
        self, *arguments: str, script: Path | None = None, cwd: Path | None = None
    ) -> tuple[int, str, str]:
        process = self.start(*arguments, script=script, cwd=cwd)
        out, err = process.communicate(timeout=20)
        return process.returncode, out, err

    def pip_calls(self) -> int:
        return len(self.notes.read_text().splitlines()) if self.notes.exists() else 0

    def installed(self) -> set[str]:
        pins = self.tools.parent / "notes.pins"
        return {line.partition("==")[0] for line in pins.read_text().splitlines()}

    def extras(self) -> list[str]:
        lines = (self.folder / ".venv/installed").read_text().splitlines()
        return [line.removeprefix("extra ") for line in lines if line.startswith("extra ")]


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    folder, tools = tmp_path / "a clone of it", tmp_path / "tools"
    folder.mkdir()
    tools.mkdir()
    (folder / "distributions" / "deeco").mkdir(parents=True)
    for name in ("acrc", "constraints.txt", "pyproject.toml", "distributions/deeco/pyproject.toml"):
        shutil.copy(ROOT / name, folder / name)
    for name in TOOLS:
        found = shutil.which(name)
        assert found is not None
        (tools / name).symlink_to(found)
    shutil.copy(Path(__file__).with_name("fake_python.sh"), tools / "python3")
    (tools / "python3").chmod(0o755)
    return Clone(folder, tools)


def test_the_script_of_ci_is_well_formed() -> None:
    subprocess.run(["bash", "-n", ROOT / ".ci/run"], check=True)
    assert os.access(ROOT / ".ci/run", os.X_OK)


def test_first_run_installs_pinned_packages_by_hash_and_second_run_nothing(clone: Clone) -> None:
    code, out, err = clone.call("run", "--robots", "3", "two words")
    assert (code, out) == (
        0,
        f"in {clone.folder}: -P -m acrc_testbed.command_line run --robots 3 two words\n",
    )
    size, first, second, last = err.splitlines()
    assert size == "acrc: .venv will take about 283 MB in total"
    assert first == "acrc: creating .venv with Python 3.11.7"
    assert second == "acrc: installing this project and 19 packages: base sim"
    assert last.startswith("acrc: .venv is ready: 0 MB in ")
    assert {"numba", "pymunk"} <= clone.installed()
    assert not {"rerun-sdk", "pytest", "lz4", "zstandard"} & clone.installed()
    assert not (clone.folder / ".venv/installer").exists()
    assert clone.call("run") == (0, f"in {clone.folder}: -P -m acrc_testbed.command_line run\n", "")
    assert clone.pip_calls() == 3
    assert not (clone.folder / ".venv/build").exists()
    # the packages are installed while the project is, so before, between or after its calls
    packages, build, project = sorted(
        clone.notes.read_text().splitlines(), key=lambda call: ("-e ." in call, "--target" in call)
    )
    assert packages.endswith("--only-binary :all: --require-hashes -r .venv/hashed.txt")
    assert build.endswith(
        "--only-binary :all: --require-hashes --upgrade --target .venv/build -r .venv/build.txt"
    )
    assert project.endswith("install --no-compile --no-deps --no-build-isolation -e distributions/deeco -e .")
    hashed = (clone.tools.parent / "notes.hashed").read_text().splitlines()
    assert all(" --hash=sha256:" in line and "\\" not in line for line in hashed)
    pins = (clone.tools.parent / "notes.pins").read_text().splitlines()
    assert pins == [line.partition(" --hash=")[0].rstrip() for line in hashed], "to constrain other packages"
    assert (clone.tools.parent / "notes.build").read_text().startswith("setuptools==")


@pytest.mark.nightly
def test_variables_of_another_environment_reach_neither_python_nor_pip(clone: Clone) -> None:
    foreign = (
        *("PYTHONPATH", "PYTHONHOME", "PYTHONOPTIMIZE", "PYTHONWARNINGS", "PYTHONUSERBASE"),
        *("PIP_TARGET", "PIP_PREFIX"),
    )
    clone.settings |= dict.fromkeys(foreign, "/opt/ros") | {"PIP_INDEX_URL": "https://here", "SHOW_ENV": "1"}
    clone.settings |= {"SHOW_BYTECODE": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    lines = clone.call("--help")[1].splitlines()
    shown = dict(line.split("=", 1) for line in lines if "=" in line)
    assert not set(foreign) & shown.keys()
    assert shown["PIP_INDEX_URL"] == "https://here" and shown["PIP_USER"] == "0"
    assert shown["ACRC_IGNORED_PYTHONPATH"] == "/opt/ros"
    assert f"byte code: {clone.folder}/.venv/bytecode, written" in lines


@pytest.mark.nightly
def test_extras_are_added_when_a_command_needs_them(clone: Clone) -> None:
    clone.call("--help")
    assert clone.extras() == []
    _, _, err = clone.call("run", "--seed", "3", "--view")
    assert "acrc: this command requires additional packages: sim observe\n" in err
    assert clone.extras() == ["observe", "sim"]
    assert {"numba", "pymunk", "rerun-sdk"} <= clone.installed()
    calls = clone.pip_calls()
    clone.call("record", "check", "out")
    assert clone.pip_calls() == calls
    with (clone.folder / "constraints.txt").open("a") as file:
        file.write("# changed\n")
    _, _, err = clone.call("--help")
    assert (
        "acrc: installing this project and 24 packages: base observe sim\n" in err
        and "creating .venv" not in err
    )


def test_a_command_installs_the_extras_that_it_needs() -> None:
    assert extras_of(EXTRAS) == EXTRAS


@pytest.mark.nightly
def test_added_packages_survive_a_new_installation(clone: Clone) -> None:
    own = clone.folder / "requirements.txt"
    clone.call("run")
    code, out, err = clone.call("add", "pandas==3.0.0", "networkx[default]")
    assert (code, out) == (0, "")
    assert own.read_text() == "pandas==3.0.0\nnetworkx[default]\n"
    assert err.splitlines()[-1] == (
        "acrc: requirements.txt lists the added packages: pandas==3.0.0 networkx[default] "
    )
    command = "install --no-compile -c .venv/pins.txt -r requirements.txt"
    assert clone.notes.read_text().splitlines()[-1].endswith(command)
    calls = clone.pip_calls()
    clone.call("add", "pandas==3.0.0")
    clone.call("run")
    assert clone.pip_calls() == calls and own.read_text().count("pandas") == 1
    with (clone.folder / "constraints.txt").open("a") as file:
        file.write("# changed\n")
    clone.call("run")
    assert clone.notes.read_text().splitlines()[-1].endswith(command)


@pytest.mark.nightly
def test_packages_that_cannot_be_installed_are_not_added(clone: Clone) -> None:
    own = clone.folder / "requirements.txt"
    assert clone.call("add") == (
        2, "", "acrc: NAME: missing; example: ./acrc add pandas networkx\n"
    )  # fmt: skip
    for name in ("--index-url", "x;y"):
        assert clone.call("add", name) == (
            2,
            "",
            f"acrc: NAME: {name}; must be a package as for pip, such as pandas or pandas==3.0.0\n",
        )
    assert not own.exists()
    clone.call("run")
    own.write_text("pandas\n")
    clone.settings["FAKE_PIP_FAILS"] = "yes"
    code, _, err = clone.call("add", "no-such-package")
    assert code == 1 and err.splitlines()[-1] == "acrc: add: no-such-package was not added"
    assert own.read_text() == "pandas\n"


@pytest.mark.nightly
def test_completion_installs_and_prints_nothing(clone: Clone) -> None:
    clone.settings["_ACRC_COMPLETE"] = "complete_bash"
    assert clone.call() == (0, "", "")
    assert clone.pip_calls() == 0 and not (clone.folder / ".venv").exists()
    del clone.settings["_ACRC_COMPLETE"]
    clone.call("--help")
    clone.settings["_ACRC_COMPLETE"] = "complete_bash"
    assert clone.call() == (0, f"in {clone.folder}: -P -m acrc_testbed.command_line\n", "")


@pytest.mark.nightly
def test_a_failed_installation_is_resumed(clone: Clone) -> None:
    clone.settings["FAKE_PIP_FAILS"] = "yes"
    code, out, err = clone.call("run")
    assert (code, out) == (1, "")
    assert err.splitlines()[-1] == ("acrc: the installation failed, see above; the same command resumes it.")
    assert not (clone.folder / ".venv/installed").exists()
    del clone.settings["FAKE_PIP_FAILS"]
    code, _, err = clone.call("run")
    assert code == 0
    assert "creating .venv" not in err


@pytest.mark.nightly
def test_two_first_uses_at_once_install_once(clone: Clone) -> None:
    clone.settings["FAKE_PIP_TAKES"] = "0.3"
    both = [clone.start("run", str(number)) for number in (1, 2)]
    ends = [(*process.communicate(timeout=20), process.returncode) for process in both]
    assert [(out, code) for out, _, code in ends] == [
        (f"in {clone.folder}: -P -m acrc_testbed.command_line run {number}\n", 0) for number in (1, 2)
    ]
    assert clone.pip_calls() == 3
    assert sorted(err.splitlines()[0] for _, err, _ in ends) == [
        "acrc: .venv will take about 283 MB in total",
        "acrc: another acrc is installing; waiting for it",
    ]


@pytest.mark.nightly
def test_links_keep_the_working_directory_and_a_moved_clone_is_installed_again(
    clone: Clone, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "link").symlink_to(clone.folder / "acrc")
    (elsewhere / "link to link").symlink_to("../link")
    code, out, _ = clone.call("run", script=elsewhere / "link to link", cwd=elsewhere)
    assert (code, out) == (0, f"in {elsewhere}: -P -m acrc_testbed.command_line run\n")
    clone.folder = clone.folder.rename(clone.folder.with_name("moved"))
    _, out, err = clone.call("run")
    assert out == f"in {clone.folder}: -P -m acrc_testbed.command_line run\n"
    assert "acrc: installing this project and 19 packages: base sim\n" in err


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"TOO_OLD": "yes", "VERSION": "3.9.2"},
         f"python3 is Python 3.9, {NEEDED} python3.11 python3.11-venv"),
        ({"NO_VENV": "yes", "VERSION": "3.12.1"},
         f"Python 3.12 lacks the module venv, {NEEDED} python3.12-venv"),
    ],
)  # fmt: skip
def test_an_unsuitable_python_is_refused(clone: Clone, settings: dict[str, str], sentence: str) -> None:
    clone.settings |= settings
    assert clone.call("run") == (1, "", f"acrc: {sentence}\n")


def test_without_python_the_error_names_the_packages(clone: Clone) -> None:
    (clone.tools / "python3").unlink()
    sentence = f"no python3 was found, {NEEDED} python3.11 python3.11-venv"
    assert clone.call("run") == (1, "", f"acrc: {sentence}\n")


@pytest.mark.nightly
def test_a_newer_python_is_found_beside_an_older_python3(clone: Clone) -> None:
    (clone.tools / "python3").rename(clone.tools / "python3.12")
    (clone.tools / "python3").write_text('#!/bin/sh\ncase "$2" in *print*) echo 3.9 ;; *) exit 1 ;; esac\n')
    (clone.tools / "python3").chmod(0o755)
    clone.settings["FAKE"] = str(clone.tools / "python3.12")
    assert clone.call("run")[:2] == (0, f"in {clone.folder}: -P -m acrc_testbed.command_line run\n")
