"""Folders that a stranger has sent: no command that looks at one runs code in it without a word of the user.

Each attack is a run that was recorded honestly and then forged. What it plants leaves a mark where it runs.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from actors.robot.assembly import RobotSetup
from actors.runtime.isolation.sandbox import NAMES, StrategyFolders
from actors.runtime.process import RunNote
from actors.runtime.recording import Entry, Note
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests import warm
from tests.replay.forging import forge

EVIL = """
from pathlib import Path
Path({mark!r}).touch()
from cleaning.strategies.none import behaviour
"""
STUDY = 'scenario = "scenario.toml"\nstrategies = ["{strategy}"]\nseeds = 1\n'


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One robot, a second, in memory."""
    out = tmp_path_factory.mktemp("honest") / "run"
    chosen = load_scenario(
        REPOSITORY / "scenarios" / "corridor.toml", Overrides(robots=1, duration=1.0, strategy="none")
    )
    swarm.run_in_memory(swarm.plan(chosen, RunOptions(out, bus="memory")), lambda progress: None)
    return out


class Received:
    """The folder as it came."""

    def __init__(self, folder: Path, run: Path) -> None:
        self.folder, self.mark = folder, folder.parent / "mark"
        self.run = shutil.copytree(run, folder / "run")
        self.here = folder.parent / "here"
        self.here.mkdir()

    def plant(self, place: str) -> Path:
        """A module that leaves the mark."""
        file = self.folder / place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(EVIL.format(mark=str(self.mark)))
        return file

    def forge(self, strategy: str, code: Sequence[Path] = ()) -> None:
        """All that names the strategy names this one; `code` is where it is said to lie."""
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
        """A command of the user's, who stands elsewhere."""
        env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        return warm.run([*map(str, words)], cwd or self.here, env, 100.0, finds_cwd=False)

    def refuses(self, *words: object, cwd: Path | None = None) -> str:
        """The sentence of a command that must not run what was planted."""
        done = self.acrc(*words, cwd=cwd)
        assert not self.mark.exists(), "what was planted has run"
        assert done.returncode == 1, done.stderr + done.stdout
        return done.stderr


@pytest.fixture
def received(honest: Path, tmp_path: Path) -> Received:
    return Received(tmp_path / "received", honest)


def commands(received: Received) -> list[tuple[object, ...]]:
    """Every command that runs the code that a run names, and the file that names it."""
    run, study = received.run, received.run / "study.toml"
    recording, scenario = run / "r1" / "r1.mcap", run / "scenario.toml"
    out = ("--out", received.here / "out")
    return [
        (scenario, "replay", run),
        (scenario, "run", scenario, "--bus", "memory", *out),
        (scenario, "run", scenario, *out),
        (scenario, "branch", f"{run}@0.5", *out),
        (study, "campaign", study, *out),
        (recording, "replay", run, "--robot", "r1"),
        (recording, "replay", run, "--robot", "r1", "--to", 0.5),
        (recording, "replay", run, "--robot", "r1"),
        (recording, "replay", run, "--robot", "r1", "--no-isolate"),
        (recording, "explain", run, "r1"),
        (recording, "explain", run, "r1@0.5"),
        (recording, "export", run),
    ]


def sentence(source: object, name: str, file: Path, word: object) -> str:
    return (
        f"acrc: {source} names the strategy {name}, whose code {file} is neither installed nor in a folder "
        f"that you have named; read it, then say --modules {word}, or --trust\n"
    )


def test_no_command_runs_what_lies_in_the_folder(received: Received) -> None:
    file = received.plant("evil.py")
    received.forge("evil:behaviour")
    for source, *words in commands(received):
        said = received.refuses(*words)
        assert said == sentence(source, "evil:behaviour", file, received.folder), words


def test_nor_does_it_where_the_user_stands_in_the_folder(received: Received) -> None:
    file = received.plant("evil.py")
    received.forge("evil:behaviour")
    for source, *words in commands(received):
        said = received.refuses(*words, cwd=received.folder)
        assert said == sentence(source, "evil:behaviour", file, "."), words


def test_a_package_that_is_a_link_into_the_library_is_not_installed(received: Received) -> None:
    received.plant("pkg/evil.py")
    library = Path(str(sys.modules["json"].__file__))
    (received.folder / "pkg" / "__init__.py").symlink_to(library)
    received.forge("pkg.evil:behaviour")
    for _, *words in commands(received):
        assert received.refuses(*words) == (
            f"acrc: {received.folder}/pkg/__init__.py: leads to {library.resolve()}; code in "
            f"{received.folder} must lie there itself\n"
        ), words


@pytest.mark.parametrize("own", ["library", "repository", "packages"])
def test_folders_that_a_run_names_count_for_nothing_whatever_their_order(
    received: Received, own: str
) -> None:
    """The check once went by the recorded order, and the program by its own."""
    first = {
        "library": Path(os.__file__).parent,
        "repository": REPOSITORY,
        "packages": Path(msgspec.__file__).parents[1],
    }[own]
    received.plant("json/evil.py")
    received.plant("json/__init__.py")
    file = received.plant("evil.py")
    places = (first, received.folder)
    received.forge("evil:behaviour", places)
    for words in (("--robot", "r1"), ("--robot", "r1", "--to", 1), ("--robot", "r1", "--pdb")):
        assert received.refuses("replay", received.run, *words) == sentence(
            received.run / "r1" / "r1.mcap", "evil:behaviour", file, received.folder
        )
    received.forge("json.evil:behaviour", places)
    for trust in ((), ("--trust",)):
        assert received.refuses("replay", received.run, "--robot", "r1", *trust) == (
            f"acrc: {received.run}/r1/r1.mcap names the strategy json.evil:behaviour, but 'json' is an "
            "installed package without such a module; if json/ is your own folder, rename it\n"
        )


def test_one_of_several_that_follow_one_another_is_enough(received: Received) -> None:
    file = received.plant("evil.py")
    received.forge("cleaning.strategies.none:behaviour>evil:behaviour@0.5")
    for source, *words in commands(received):
        assert received.refuses(*words) == sentence(source, "evil:behaviour", file, received.folder), words


def test_a_typed_strategy_lets_no_other_one_in(received: Received) -> None:
    """Of a branch the part before the change is the recorded strategy's."""
    received.plant("mine.py")
    file = received.plant("evil.py")
    received.forge("evil:behaviour")
    words = (f"{received.run}@0.5", "--strategy", "mine:behaviour", "--out", received.here / "o")
    assert received.refuses("branch", *words, cwd=received.folder) == sentence(
        received.run / "scenario.toml", "evil:behaviour", file, "."
    )


def test_bytecode_beside_a_named_folders_modules_does_not_run(received: Received) -> None:
    """Who has read a module has not read what lies in `__pycache__`."""
    import py_compile  # noqa: PLC0415

    planted = received.plant("read.py")
    mode = py_compile.PycInvalidationMode.UNCHECKED_HASH
    assert py_compile.compile(str(planted), invalidation_mode=mode)
    py_compile.compile(str(planted), str(received.folder / "only.pyc"))
    planted.write_text("from cleaning.strategies.none import behaviour\n")
    received.forge("read:behaviour")
    named = ("--modules", received.folder)
    done = received.acrc("replay", received.run, *named)
    assert done.returncode == 0, done.stderr
    assert received.acrc("replay", received.run, "--robot", "r1", *named).returncode == 0
    assert not received.mark.exists()


def test_what_python_would_run_by_itself_does_not_run(received: Received) -> None:
    """Nothing in the folder stands on Python's path, so its start-up files and its libraries are none."""
    received.plant("evil.py")
    for name in ("sitecustomize.py", "usercustomize.py", "numpy.py", "actors.py", "colorsys.py", "deploy.py"):
        received.plant(name)
    (received.folder / "evil.pth").write_text(f"import sys; open({str(received.mark)!r}, 'w')\n")
    shutil.copy(received.folder / "evil.pth", received.run / "evil.pth")
    received.forge("cleaning.strategies.none:behaviour")
    for words in (("replay", received.run), ("replay", received.run, "--robot", "r1")):
        done = subprocess.run(  # an interpreter of its own, as the user begins one
            [sys.executable, "-P", "-m", "command_line", *map(str, words)],
            cwd=received.folder, capture_output=True, text=True, check=False,
            env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert not received.mark.exists(), words


def test_an_empty_entry_of_pythonpath_is_not_the_folder_where_one_stands(received: Received) -> None:
    for name in ("sitecustomize.py", "typer.py", "evil.py"):
        received.plant(name)
    received.forge("evil:behaviour")
    env = {**os.environ, "PYTHONPATH": f":.:{received.here}:runs:"}
    done = subprocess.run(
        [REPOSITORY / "acrc", "replay", received.run, "--robot", "r1"],
        cwd=received.folder, capture_output=True, text=True, check=False, env=env,
    )  # fmt: skip
    assert done.returncode == 1 and not received.mark.exists(), done.stderr
    assert done.stderr == sentence(
        received.run / "r1" / "r1.mcap", "evil:behaviour", received.folder / "evil.py", "."
    )


def test_looking_at_a_scenario_runs_nothing(received: Received) -> None:
    received.plant("evil.py")
    received.forge("evil:behaviour")
    done = received.acrc("scenario", received.run / "scenario.toml", cwd=received.folder)
    assert not received.mark.exists() and "Traceback" not in done.stderr


def test_a_fleet_names_no_code_either(received: Received) -> None:
    file = received.plant("evil.py")
    text = (REPOSITORY / "fleets" / "office.toml").read_text().replace("../maps", str(REPOSITORY / "maps"))
    fleet = received.folder / "fleet.toml"
    fleet.write_text(text.replace('strategy = "chapter"', 'strategy = "evil:behaviour"'))
    told = sentence(fleet, "evil:behaviour", file, ".").removeprefix("acrc: ").strip()
    for cwd in (received.here, received.folder):
        told = told.replace("--modules .", f"--modules {received.folder}") if cwd == received.here else told
        onboard = received.refuses("fleet", "onboard", fleet, "--robot", "r1", cwd=cwd)
        doctor = received.acrc("fleet", "doctor", fleet, "--robot", "r1", cwd=cwd)
        told = told.replace(f"--modules {received.folder}", "--modules .") if cwd == received.folder else told
        assert not received.mark.exists()
        assert onboard == f"acrc: {told}\n"
        assert told in doctor.stdout.replace("\n", " ")


def test_with_a_word_it_runs(received: Received) -> None:
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
            else f"acrc: {received.run}: was recorded without the hashes of its strategy's modules, which "
            "may be others here\n"
        )
    done = received.acrc("replay", received.run, "--modules", ".", cwd=received.folder)
    assert done.returncode == 0 and received.mark.exists()
