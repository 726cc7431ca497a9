"""`python -m deeco.explain`: whole texts, and a sentence for every wrong argument."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from deeco.explain.command import main

ROOT = Path(__file__).parents[2]
EXPLAINED = Path(__file__).parent / "explained"
HERE = "tests.deeco.cleaners"
PAIR = (f"{HERE}:CleaningRobot", f"{HERE}:CAREFUL")


def explained(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    return captured.err.removeprefix("deeco.explain: ").removesuffix("\n")


def test_in_words_and_drawn_with_characters(capsys: pytest.CaptureFixture[str]) -> None:
    assert explained(capsys, *PAIR) == (EXPLAINED / "robot.txt").read_text()


def test_drawn_for_mermaid(capsys: pytest.CaptureFixture[str]) -> None:
    assert explained(capsys, "--mermaid", *PAIR) == (EXPLAINED / "robot.mmd").read_text()


def test_every_end_of_an_arrow_is_a_node_of_the_chart(capsys: pytest.CaptureFixture[str]) -> None:
    lines = explained(capsys, "--mermaid", HERE).splitlines()
    arrows = [match for line in lines if (match := re.match(r" *(\w+) (?:-- .* -->|---) (\w+)$", line))]
    nodes = [match[1] for line in lines if (match := re.match(r" *(?:subgraph )?(\w+)[\[({]", line))]
    assert arrows
    assert {end for arrow in arrows for end in arrow.groups()} <= set(nodes)
    assert len(nodes) == len(set(nodes))


def test_an_ensemble_by_its_class_has_the_parameters_of_its_class(capsys: pytest.CaptureFixture[str]) -> None:
    text = explained(capsys, f"{HERE}:DestinationAdoption")
    assert "    parameters   max_distance: float = 3.0, backoff: Duration = 10 s\n" in text
    assert "layer" not in text, "there is no component to draw"


def test_what_cannot_be_told_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    text = explained(capsys, f"{HERE}:Riddle")
    assert "    cannot tell  what `replace(self, **tables)` writes\n" in text
    assert "More may be read or written than the table says, by guess: see above.\n" in text


def test_a_module_is_all_that_it_defines_and_nothing_that_it_imports(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = explained(capsys, HERE).splitlines()
    told = [line.split(",")[0] for line in lines if re.match(r"\w+, an? (component|ensemble)", line)]
    assert told == ["CleaningRobot", "Idler", "Riddle", "DestinationAdoption", "Charging"]


DEFINES = f"{HERE} defines CleaningRobot, Idler, Riddle, DestinationAdoption, Charging"
WRONG = {
    "nowhere:Robot": (
        "there is no module 'nowhere' here; it should be written as in an import, such as examples.convoy, "
        "and be found from the current folder"
    ),
    f"{HERE}:Robott": f"there is no 'Robott' in {HERE}; {DEFINES}",
    f"{HERE}:Cleaner": f"{HERE}:Cleaner is a role, which by itself does nothing; {DEFINES}",
    f"{HERE}:Point": f"{HERE}:Point is a class without @component and @ensemble; {DEFINES}",
    f"{HERE}:ROBOT": (
        f"{HERE}:ROBOT is an instance of the component CleaningRobot, whose class should be named; {DEFINES}"
    ),
    f"{HERE}:START": f"{HERE}:START is of type int, neither a component nor an ensemble; {DEFINES}",
    "deeco.instant": (
        "deeco.instant has no class with @component or @ensemble; name another module, or one of its classes"
    ),
    "examples.convoy:": (
        "'examples.convoy:' names nothing; it should be 'module:Component', 'module:Ensemble' or 'module'"
    ),
}


@pytest.mark.parametrize("argument", WRONG)
def test_a_wrong_argument(capsys: pytest.CaptureFixture[str], argument: str) -> None:
    assert refused(capsys, *PAIR, argument) == WRONG[argument]


def test_a_module_that_cannot_be_imported(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "needy.py").write_text("import nowhere_at_all\n")
    assert refused(capsys, "needy") == (
        "the module 'needy' cannot be imported, for it needs 'nowhere_at_all', which is not installed"
    )
    (tmp_path / "unsound.py").write_text("from deeco import on_change\non_change()\n")
    assert refused(capsys, "unsound") == "@on_change() should name a fact, such as Cleaner.is_blocked"


def test_from_the_command_line() -> None:
    command = [sys.executable, "-m", "deeco.explain"]
    run = subprocess.run([*command, *PAIR], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, (EXPLAINED / "robot.txt").read_text())
