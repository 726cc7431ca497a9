"""How the commands on the pages are tried.

Each is run by the tests as it stands, in a folder with what a clone has, after those above it on its page.
What takes long is run shortened, and as it stands by night. A command that no test runs says so itself, where
it stands: `# … (not run by tests: opens a window)`.
"""

import re
import shlex
from types import MappingProxyType
from typing import Final, NamedTuple

from command_line.documentation.markdown import Block

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
    "./acrc verify navigation --log cycles.zip --map maps/corridor.yaml --robots 4 --seed 7": "--goals 8",
    "./acrc verify localisation --log course.zip --cell 'tracking/*/360/kobuki/4/*' --seed 7": "--duration 9",
    "./acrc verify localisation --from course.zip --runs 20": "--runs 1",
    "./acrc verify localisation --from logs/ --against theirs.json --runs 10": "--runs 1",
})  # fmt: skip
"""Words behind a command, by the command, with which the suite runs what takes long."""

PAGES: Final[MappingProxyType[tuple[str, str], str]] = MappingProxyType({
    ("docs/tutorial.md", "sh"): "tests/cli/test_tutorial.py",
    ("docs/tutorial.md", "python"): "tests/cli/test_tutorial.py",
    ("docs/deeco.md", "python"): "tests/deeco/test_docs.py",
    ("docs/library.md", "python"): "tests/library/test_library.py",
    ("docs/tables.md", "python"): "tests/recordings/test_export.py",
    ("docs/clusters.md", "python"): "tests/clusters/test_files.py",
    ("docs/clusters.md", "yaml"): "tests/experiments/test_cluster.py",
    ("docs/localisation-log.md", "python"): "tests/localisation_bench/test_log.py",
    ("docs/navigation-log.md", "python"): "tests/navigation_bench/test_navigation_log.py",
})  # fmt: skip
"""Pages whose blocks of a language have a test of their own, which shows that they do what the page says."""


TYPED_ELSEWHERE: Final[MappingProxyType[str, str]] = MappingProxyType({
    "./acrc demo": "tests/pictures/test_pictures.py",
})  # fmt: skip
"""What takes long and stands on several pages: a test of its own types it, and looks at all that it shows."""


class Command(NamedTuple):
    """A command as it stands on a page."""

    words: str
    """Without what is said behind `#`."""
    untried: str
    """Why no test runs it, as the page says; empty: tests do."""


def commands(block: Block) -> list[Command]:
    """The commands of a block in `sh`, one a line."""
    lines = (line.partition(" #") for line in block.text.replace("\\\n", " ").splitlines())
    return [
        Command(words.strip(), found[1] if (found := _UNTRIED.search(said.strip())) else "")
        for words, _, said in lines
        if shlex.split(words, comments=True)
    ]


def shortened(command: Command) -> str:
    """The command as the suite runs it."""
    return f"{command.words} {SHORTENED.get(command.words, '')}".rstrip()


def mark(block: Block) -> str:
    """What stands below a block on the site: which of its commands the suite shortens; or ""."""
    return " ".join(
        f"Tested at reduced size: `{shortened(command)}`."
        for command in commands(block)
        if command.words in SHORTENED
    )
