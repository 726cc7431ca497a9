"""How the commands on the documentation pages are run by the nightly tests.

Each command runs as it stands, in a folder with the files of a clone, after those above it on its page.
Commands that take long run shortened. A page marks a command that no test runs: `# … (not run by tests: …)`.
"""

import re
import shlex
from types import MappingProxyType
from typing import Final, NamedTuple

from tests.documentation.markdown import Block

_UNTRIED: Final = re.compile(r"\(not run by tests: ([^)]+)\)$")

SHORTENED: Final[MappingProxyType[str, str]] = MappingProxyType({
    "./acrc run": "--duration 5",
    "./acrc run --seed 3": "--duration 5",
    "./acrc run --robots 8 --seed 3 --duration 300": "--duration 5",
    "./acrc run --bus memory --json": "--duration 5",
    "./acrc run --strategy my_study.lease:behaviour": "--duration 5",
    "./acrc run --hardware-in-the-loop": "--duration 2",
    "./acrc run scenarios/head_on.toml --strategy chapter --json": "--duration 5",
    "./acrc run scenarios/head_on.toml --hardware-in-the-loop": "--duration 2",
    "./acrc run scenarios/chapter.toml --seed 42 --out runs/chapter": "--duration 5",
    "./acrc run scenarios/head_on.toml --strategy examples.courteous:behaviour --check": "--duration 5",
    "./acrc run scenarios/head_on.toml --out runs/seen": "--duration 20",
    "./acrc run scenarios/head_on.toml --log r2 --out runs/said": "--duration 20",
    "./acrc run scenarios/head_on.toml --strategy chapter --out runs/tables": "--duration 5",
    "./acrc campaign --preset chapter": "--robots 2 --seeds 1 --duration 2",
    "./acrc campaign --strategies none,chapter --seeds 40 --out campaigns/chapter":
        "--robots 2 --seeds 2 --duration 2",
    "./acrc bench swarm": "--robots 1 --duration 1 --repeat 1",
    ".venv/bin/python -m tests.localisation.courses course.zip --seed 7": "--duration 9",
    "./acrc verify localisation --from course.zip --runs 20": "--runs 1",
    "./acrc verify localisation --from logs/ --against theirs.json --runs 10": "--runs 1",
})  # fmt: skip
"""Options that shorten a command, by command."""

PAGES: Final[MappingProxyType[tuple[str, str], str]] = MappingProxyType({
    ("docs/tutorial.md", "sh"): "tests/cli/test_tutorial.py",
    ("docs/tutorial.md", "python"): "tests/cli/test_tutorial.py",
    ("docs/deeco.md", "python"): "tests/deeco/test_programs.py",
    ("docs/library.md", "python"): "tests/library/test_library.py",
    ("docs/tables.md", "python"): "tests/recordings/test_export.py",
    ("docs/clusters.md", "python"): "tests/clusters/test_clusters.py",
    ("docs/clusters.md", "yaml"): "tests/experiments/test_cluster.py",
    ("docs/localisation-log.md", "python"): "tests/localisation/test_logs.py",
})  # fmt: skip
"""Tests of their own for the blocks of a language on a page."""


class Command(NamedTuple):
    """A command on a page."""

    words: str
    """Without the comment."""
    untried: str
    """The reason why no test runs it, as the page states it; empty: tests run it."""


def commands(block: Block) -> list[Command]:
    """Return the commands of a block in `sh`, one per line."""
    lines = (line.partition(" #") for line in block.text.replace("\\\n", " ").splitlines())
    return [
        Command(words.strip(), found[1] if (found := _UNTRIED.search(said.strip())) else "")
        for words, _, said in lines
        if shlex.split(words, comments=True)
    ]


def shortened(command: Command) -> str:
    """Return the command as the tests run it."""
    return f"{command.words} {SHORTENED.get(command.words, '')}".rstrip()
