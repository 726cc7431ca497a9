"""Folders from elsewhere: no command runs code in them without `--modules` or `--trust`.

Each attack is a recorded run that was forged. A planted module creates a file where it runs.
"""

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from actors.robot.assembly import RobotSetup
from actors.runtime.isolation.sandbox import NAMES, StrategyFolders
from actors.runtime.process import RunNote
from actors.runtime.recording import Entry, Note
from tests import in_process, warm
from tests.recorded_runs import record
from tests.replay.forging import forge

EVIL = """
from pathlib import Path
Path({mark!r}).touch()
from cleaning.strategies.none import behaviour
"""
STUDY = 'scenario = "scenario.toml"\nstrategies = ["{strategy}"]\nseeds = 1\n'


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("honest") / "run"
    record(out, REPOSITORY / "scenarios" / "corridor.toml", robots=1, duration=1.0, strategy="none")
    return out


class ReceivedFolder:
    def __init__(self, folder: Path, run: Path) -> None:
        self.folder, self.mark = folder, folder.parent / "mark"
        self.run = shutil.copytree(run, folder / "run")
        self.here = folder.parent / "here"
        self.here.mkdir()

    def plant(self, place: str) -> Path:
        file = self.folder / place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(EVIL.format(mark=str(self.mark)))
        return file

    def forge(self, strategy: str, code: Sequence[Path] = ()) -> None:
        """Change the strategy in all files of the run; `code` is the recorded folder of its module."""
        scenario = self.run / "scenario.toml"
        text = re.sub(r"(?m)^modules = .*\n", "", scenario.read_text())
        text = re.sub(r'strategy = ".*"', f'strategy = "{strategy}"\nmodules = ".."', text, count=1)
        assert strategy in text
        scenario.write_text(text)
        (self.run / "study.toml").write_text(STUDY.format(strategy=strategy))

        def changed(item: Entry | Note) -> Entry | Note:
            if not isinstance(item, Note) or item.name != "run":
                return item
            note = msgspec.json.decode(item.json, type=RunNote)
            told = msgspec.json.decode(note.setup, type=RobotSetup)
            setup = msgspec.Raw(msgspec.json.encode(msgspec.structs.replace(told, behaviour=strategy)))
            text = msgspec.json.encode(msgspec.structs.replace(note, setup=setup))
            return item._replace(json=text.decode())

        names = StrategyFolders(str(self.run), tuple(map(str, code or (self.folder,))))
        (self.run / NAMES).write_bytes(msgspec.json.encode(names))
        forge(self.run / "r1" / "r1.mcap", changed)

    def acrc(self, *words: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run a command in a process that may load planted code, from another folder by default."""
        env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        return warm.run([*map(str, words)], cwd or self.here, env, 100.0, finds_cwd=False)

    def refuses(self, *words: object, cwd: Path | None = None) -> str:
        done = in_process.acrc(*words, cwd=cwd or self.here)
        assert not self.mark.exists(), "what was planted has run"
        assert done.returncode == 1, done.stderr + done.stdout
        return done.stderr


@pytest.fixture
def received(honest: Path, tmp_path: Path) -> ReceivedFolder:
    return ReceivedFolder(tmp_path / "received", honest)


def commands(received: ReceivedFolder) -> list[tuple[object, ...]]:
    """Return the commands that run a recorded strategy, each after the file that names it."""
    run, study = received.run, received.run / "study.toml"
    recording, scenario = run / "r1" / "r1.mcap", run / "scenario.toml"
    out = ("--out", received.here / "out")
    return [
        (scenario, "replay", run),
        (scenario, "run", scenario, "--bus", "memory", *out),
        (scenario, "branch", f"{run}@0.5", *out),
        (study, "campaign", study, *out),
        (recording, "replay", run, "--robot", "r1"),
        (recording, "replay", run, "--robot", "r1", "--to", 0.5),
        (recording, "explain", run, "r1"),
    ]


def sentence(source: object, name: str, file: Path, word: object) -> str:
    return (
        f"acrc: {source}: strategy {name}: its code {file} is neither installed nor in a "
        f"permitted folder; read it, then add --modules {word}, or --trust\n"
    )


@pytest.mark.parametrize("inside", [False, True])
def test_no_command_runs_code_in_the_folder(received: ReceivedFolder, inside: bool) -> None:
    file = received.plant("evil.py")
    for strategy in ("evil:behaviour", "cleaning.strategies.none:behaviour>evil:behaviour@0.5"):
        received.forge(strategy)
        for source, *words in commands(received):
            error = received.refuses(*words, cwd=received.folder if inside else None)
            word = "." if inside else received.folder
            assert error == sentence(source, "evil:behaviour", file, word), words


def test_folders_that_a_run_names_are_not_trusted(received: ReceivedFolder) -> None:
    received.plant("json/evil.py")
    received.plant("json/__init__.py")
    file = received.plant("evil.py")
    places = (Path(msgspec.__file__).parents[1], received.folder)
    received.forge("evil:behaviour", places)
    assert received.refuses("replay", received.run, "--robot", "r1") == sentence(
        received.run / "r1" / "r1.mcap", "evil:behaviour", file, received.folder
    )
    received.forge("json.evil:behaviour", places)
    assert received.refuses("replay", received.run, "--robot", "r1", "--trust") == (
        f"acrc: {received.run}/r1/r1.mcap: strategy json.evil:behaviour: 'json' is an "
        "installed package without such a module; if json/ is your own folder, rename it\n"
    )


def test_start_up_files_of_python_in_the_folder_do_not_run(received: ReceivedFolder) -> None:
    for name in ("sitecustomize.py", "usercustomize.py", "typer.py", "numpy.py", "actors.py", "evil.py"):
        received.plant(name)
    (received.folder / "evil.pth").write_text(f"import sys; open({str(received.mark)!r}, 'w')\n")
    received.forge("evil:behaviour")
    done = subprocess.run(
        [REPOSITORY / "acrc", "replay", received.run, "--robot", "r1"],
        cwd=received.folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": f":.:{received.here}:runs:"},
    )  # fmt: skip
    assert not received.mark.exists()
    assert done.stderr == sentence(
        received.run / "r1" / "r1.mcap", "evil:behaviour", received.folder / "evil.py", "."
    )


def test_scenario_and_fleet_commands_run_no_code(received: ReceivedFolder) -> None:
    file = received.plant("evil.py")
    received.forge("evil:behaviour")
    done = in_process.acrc("scenario", received.run / "scenario.toml", cwd=received.folder)
    assert not received.mark.exists() and "Traceback" not in done.stderr
    text = (REPOSITORY / "fleets" / "office.toml").read_text().replace("../maps", str(REPOSITORY / "maps"))
    fleet = received.folder / "fleet.toml"
    fleet.write_text(text.replace('strategy = "chapter"', 'strategy = "evil:behaviour"'))
    error = sentence(fleet, "evil:behaviour", file, received.folder)
    assert received.refuses("fleet", "onboard", fleet, "--robot", "r1") == error
    doctor = in_process.acrc("fleet", "doctor", fleet, "--robot", "r1", cwd=received.here)
    assert not received.mark.exists()
    assert error.removeprefix("acrc: ").strip() in doctor.stdout.replace("\n", " ")


def test_with_modules_or_trust_it_runs(received: ReceivedFolder) -> None:
    received.plant("evil.py")
    received.forge("evil:behaviour")
    for word in (("--modules", received.folder), ("--trust",)):
        done = received.acrc("replay", received.run, *word)
        assert done.returncode == 0, done.stderr
        assert received.mark.exists()
        received.mark.unlink()
        assert done.stderr == (
            ""
            if word == ("--trust",)
            else f"acrc: {received.run}: recorded without hashes of the strategy's modules; they "
            "may differ here\n"
        )
