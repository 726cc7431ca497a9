"""Every block of code on a page does what it says: commands run, settings are understood, Python runs.

Each page has a folder of its own with what a clone has. A command is run unless the page says beside it that
no test does; `documentation.trials` says what is shortened, and has its full length by night.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from command_line.documentation.markdown import Block, pages
from command_line.documentation.trials import PAGES as PAGES_OF_THEIR_OWN
from command_line.documentation.trials import SHORTENED, TYPED_ELSEWHERE, Command, commands, shortened
from deploy.scenario.scenario_file import parse
from experiments.study.study_file import load_study
from tests import warm

PAGES = {page.name: page for page in pages() if page.blocks()}
LANGUAGES = {"sh", "python", "toml", "yaml", "text", "mermaid", "{eval-rst}", "{toctree}"}
IN_A_CLONE = ("scenarios", "studies", "maps", "examples", "fleets")
LEASE = "from cleaning.strategies.chapter import behaviour as behaviour\n"
LEAST = {
    "map": 'map = "maps/corridor.yaml"',
    "run": '[run]\nduration = 60.0\nstrategy = "none"',
    "robots": "[robots]\ncount = 1",
    "places": '[places]\npreset = "golden"',
}
"""What every scenario has, by its key; the first one is no table."""


@pytest.fixture
def clone() -> Iterator[Path]:
    """A folder with what a clone has, and with the files that the pages take for given."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as name:  # shorter than pytest's: sockets will lie in it
        folder = Path(name)
        for given in IN_A_CLONE:
            shutil.copytree(REPOSITORY / given, folder / given)
        (folder / "actors").mkdir()
        (folder / "actors" / "models").symlink_to(REPOSITORY / "actors" / "models")
        (folder / "my_study").mkdir()
        (folder / "my_study" / "lease.py").write_text(LEASE)
        yield folder


def type_in(clone: Path, command: str, timeout_s: float) -> str:
    """What a command prints; it must succeed."""
    runs = [file.parent for file in (clone / "runs").glob("*/scenario.toml")]
    newest = max(runs, key=lambda path: path.stat().st_mtime, default=None)
    program, *words = shlex.split(command.replace("runs/NAME", str(newest)))
    env = os.environ | {"PYTHONPATH": str(REPOSITORY), "COLUMNS": "200"}
    if program == "./acrc":
        done = warm.run(words, clone, env, timeout_s, finds_cwd=False)
    else:
        assert program in {".venv/bin/python", "openssl"}, command
        done = subprocess.run(
            [program.replace(".venv/bin/python", sys.executable), *words], cwd=clone, env=env,
            capture_output=True, text=True, timeout=timeout_s, check=False,
        )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def typed(name: str) -> list[Command]:
    """The commands of a page that tests run, and no test of the page's or of their own does."""
    if (name, "sh") in PAGES_OF_THEIR_OWN:
        return []
    blocks = [block for block in PAGES[name].blocks() if block.language == "sh"]
    return [command for block in blocks for command in commands(block) if is_typed(command)]


def is_typed(command: Command) -> bool:
    return not command.untried and command.words not in TYPED_ELSEWHERE


def test_every_block_has_a_language_that_is_looked_at() -> None:
    others = {
        (name, b.language)
        for name, page in PAGES.items()
        for b in page.blocks()
        if b.language not in LANGUAGES
    }
    assert others == set()


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [name for name in PAGES if typed(name)])
def test_the_commands_of_a_page_run(name: str, clone: Path) -> None:
    give(clone, name)
    for command in typed(name):
        type_in(clone, shortened(command), 280.0)


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", [n for n in PAGES if any(c.words in SHORTENED for c in typed(n))])
def test_the_commands_of_a_page_run_at_full_size(name: str, clone: Path) -> None:
    give(clone, name)
    for command in typed(name):
        type_in(clone, command.words, 7000.0)


def give(clone: Path, name: str) -> None:
    """What the commands of one page want beside that: logs, and what another program made of them."""
    if name == "docs/localisation-log.md":
        (clone / "logs").mkdir()
        type_in(clone, "./acrc verify localisation --log logs/course.zip --cell alone --duration 20", 200.0)
        theirs = [{"log": "course", "runs": [{"rmse": 0.05, "lost": False}, {"rmse": 0.04, "lost": False}]}]
        (clone / "theirs.json").write_bytes(msgspec.json.encode(theirs))
    if name == "docs/experiments.md":
        type_in(clone, "./acrc run scenarios/head_on.toml --bus memory --duration 5", 100.0)


def of(language: str) -> list[tuple[str, int]]:
    """Page and line of each block in a language that has no test of its own."""
    found = [(name, block) for name, page in PAGES.items() for block in page.blocks()]
    return [
        (name, block.line)
        for name, block in found
        if block.language == language and (name, language) not in PAGES_OF_THEIR_OWN
    ]


def block_at(name: str, line: int) -> Block:
    return next(block for block in PAGES[name].blocks() if block.line == line)


@pytest.mark.parametrize(("name", "line"), of("toml"))
def test_settings_are_understood(name: str, line: int, clone: Path) -> None:
    text = block_at(name, line).text
    found = tomllib.loads(text)
    if "strategies" in found:
        (clone / "study.toml").write_text(text)
        assert load_study(clone / "study.toml").trials()
        return
    before, *behind = (given if key not in found else "" for key, given in LEAST.items())
    whole = "\n".join((before, text, *behind))
    parse(whole, clone / "scenario.toml")


def test_python_runs(clone: Path) -> None:
    for name, line in of("python"):
        (clone / "block.py").write_text(block_at(name, line).text)
        type_in(clone, ".venv/bin/python block.py", 60.0)


def test_a_command_that_fails_is_found(clone: Path) -> None:
    with pytest.raises(AssertionError, match=re.escape("./acrc run nowhere.toml: ")):
        type_in(clone, "./acrc run nowhere.toml", 60.0)
