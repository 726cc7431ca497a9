"""A state of the project that runs by its own words: this one, a clone in another folder, or a commit."""

import json
import os
import subprocess
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from actors.installation.repository import REPOSITORY, clone
from actors.installation.usage import OptionError, wrong_value
from actors.runtime.errors import AcrcError
from benchmarks.statistics.commands import spent

HERE: Final = "here"
_FOREIGN: Final = ("PYTHONPATH", "NUMBA_")
"""How variables begin that would bring code of one state into another."""


@dataclass(frozen=True)
class PairedCase:
    """A swarm that both states run."""

    robots: int
    seconds: float
    """Simulated."""
    bus: str
    seed: int | None = None
    """None: the scenario's."""
    scenario: Path | None = None
    """Absolute; None: the scenario `chapter` of each state."""
    navigation: str | None = None
    """Preset that this state alone runs with; None: the scenario's."""


@dataclass(frozen=True)
class RunCost:
    """What one run took."""

    digest: str
    wall_s: float
    """From the first step to the last."""
    command_s: float
    """From Enter to the prompt."""
    cpu_s: float
    """Of all processes of the command."""


@dataclass(frozen=True)
class ProjectState:
    """A clone whose `acrc` makes its own `.venv` when it is first called."""

    name: str
    folder: Path

    @property
    def chapter(self) -> Path:
        """Its scenario `chapter`."""
        return self.folder / "scenarios" / "chapter.toml"

    def run(self, case: PairedCase) -> RunCost:
        """Run it once, in a folder that is gone afterwards. Raises AcrcError with its last words."""
        seed = () if case.seed is None else ("--seed", str(case.seed))
        own = () if case.navigation is None or self.name != HERE else ("--navigation", case.navigation)
        env = {name: value for name, value in os.environ.items() if not name.startswith(_FOREIGN)}
        with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
            words = (
                *(str(self.folder / "acrc"), "run", str(case.scenario or self.chapter)),
                *("--robots", str(case.robots), "--duration", f"{case.seconds:g}", *seed, *own),
                *("--bus", case.bus, "--json", "--out", str(Path(folder) / "out")),
            )
            of = spent(words, self.folder, env)
        try:
            told = json.loads(of.answer)
            return RunCost(told["digest"], told["wall_s"], of.wall_s, of.cpu_s)
        except (ValueError, KeyError, TypeError):
            raise AcrcError(f"{self.name}: acrc run --json answers {of.answer[:80]!r}, no result") from None

    def python(self) -> str:
        """The version of its Python, once it has run."""
        return spent([str(self.folder / ".venv" / "bin" / "python"), "-V"]).answer.strip()

    def packages(self) -> int:
        """How many its `.venv` has, once it has run."""
        return len(list(self.folder.glob(".venv/lib/python*/site-packages/*.dist-info")))


def here() -> ProjectState:
    """This one. Raises AcrcError outside of a clone."""
    return ProjectState(HERE, clone("acrc bench beside"))


@contextmanager
def other(what: str) -> Iterator[ProjectState]:
    """The state that a commit or the folder of a clone is; what is made of a commit is gone afterwards.

    Raises OptionError for anything else, and AcrcError if git does not give it.
    """
    if Path(what).is_dir():
        if not (Path(what) / "acrc").is_file():
            raise wrong_value("COMMIT", what, "a clone, which has a file acrc")
        yield ProjectState(what, Path(what).resolve())
        return
    if _git("rev-parse", "--verify", "--quiet", f"{what}^{{commit}}", "--").returncode != 0:
        raise wrong_value("COMMIT", what, "a commit of this repository, or the folder of a clone")
    with tempfile.TemporaryDirectory(prefix="acrc-") as scratch:
        folder = Path(scratch) / "clone"
        try:
            made = _git("worktree", "add", "--detach", str(folder), what)
            if made.returncode != 0:
                raise AcrcError(f"git gives no worktree of {what}: {made.stderr.strip()[-300:]}")
            if not (folder / "acrc").is_file():
                raise wrong_value("COMMIT", what, "one that has a file acrc")
            yield ProjectState(what, folder)
        finally:
            _git("worktree", "remove", "--force", str(folder))


def _git(*words: str) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(
            ["git", "-C", str(REPOSITORY), *words], capture_output=True, text=True, check=False
        )
    except OSError as error:
        raise AcrcError(f"git cannot be started: {error.strerror}; a folder of a clone would do") from None


def unlike(mine: ProjectState, theirs: ProjectState, case: PairedCase) -> Iterator[str]:
    """Why their times do not compare, as far as it can be read, in a sentence each; both have run."""
    pythons = mine.python(), theirs.python()
    if pythons[0] != pythons[1]:
        yield f"{mine.name} has {pythons[0]}, {theirs.name} {pythons[1]}: they compare Pythons, too"
    packages = mine.packages(), theirs.packages()
    if packages[0] != packages[1]:
        yield (
            f"{mine.name} has {packages[0]} packages in its .venv, {theirs.name} {packages[1]}: with more of "
            "them a command starts later; a new clone has what a run needs and no more"
        )
    if case.scenario is None and (keys := _differing(*map(_keys, (mine.chapter, theirs.chapter)))):
        yield (
            f"their scenarios differ, so that their work may, too: {'; '.join(keys)}; "
            "--scenario FILE has both run the same one"
        )


def _keys(scenario: Path) -> dict[str, Any]:
    try:
        return dict(_flat(tomllib.loads(scenario.read_text())))
    except (OSError, ValueError) as error:
        raise OptionError(
            f"{scenario}: cannot be read ({error}); --scenario FILE has both run another"
        ) from None


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield before + key, value


def _differing(mine: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[str]:
    return [
        f"{key} is {mine.get(key, 'not set')} here, {theirs.get(key, 'not set')} there"
        for key in {**mine, **theirs}
        if mine.get(key) != theirs.get(key)
    ]
