"""`mypy --strict` finds every mistake of mistakes/mistaken.txt, on its line, and none in its corrected twin.

The twins are no .py files, so that the type check of the repository does not see them.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent / "mistakes"
ROOT = Path(__file__).parents[2]
MARK = "# mistake: "


def lines(name: str) -> list[str]:
    return (HERE / f"{name}.txt").read_text().splitlines()


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[int]]:
    """The lines that mypy complains about, for both twins."""
    folder = tmp_path_factory.mktemp("mistakes")
    for name in ("mistaken", "corrected"):
        (folder / f"{name}.py").write_text("\n".join(lines(name)) + "\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir=cache", "--no-pretty"]
    run = subprocess.run(
        [*command, "mistaken.py", "corrected.py"],
        cwd=folder,
        env={"MYPYPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 1, run.stdout + run.stderr
    found: dict[str, set[int]] = {"mistaken": set(), "corrected": set()}
    for line in run.stdout.splitlines():
        if place := re.match(r"(.+?):(\d+): error: ", line):
            found.setdefault(Path(place[1]).stem, set()).add(int(place[2]))
    return found


def test_every_mistake_is_found_on_its_line_and_nothing_else(reported: dict[str, set[int]]) -> None:
    marked = {number: line for number, line in enumerate(lines("mistaken"), start=1) if MARK in line}
    assert {number: marked.get(number) for number in sorted(reported["mistaken"])} == marked
    assert set(reported) == {"mistaken", "corrected"}


def test_the_corrected_twin_is_clean_and_runs(reported: dict[str, set[int]]) -> None:
    assert reported["corrected"] == set()
    exec("\n".join(lines("corrected")), {"__name__": "corrected"})


def test_the_twins_differ_in_their_mistakes_only() -> None:
    """So each report comes from its own mistake; some take a line or two more."""
    pairs = zip(lines("mistaken"), lines("corrected"), strict=True)
    differing = [wrong.strip() for wrong, right in pairs if wrong != right]
    assert [line for line in differing if MARK not in line] == [
        "def report(self) -> None:",
        "return",
        "replace(self, state=State.BLOCKED)",
        "pass",
        "def membership(self, coordinator: Cleaner, member: Cleaner) -> None:",
        "coordinator.is_blocked()",
    ]
    assert sum(MARK in line for line in differing) == sum(MARK in line for line in lines("mistaken"))


def test_the_eight_mistakes_of_the_comparison_are_among_them() -> None:
    said = {line.split(MARK)[1] for line in lines("mistaken") if MARK in line}
    assert said >= {
        "a local field of a peer is read",
        "the remote side is written",
        "a local field written in place",
        "a typo in what is written",
        "a wrong type is written",
        "the wrong side is given",
        "seconds where a Duration is due",
        "a process that gives no knowledge",
    }
