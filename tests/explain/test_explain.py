"""`python -m deeco.explain`: complete output, and an error for each invalid argument."""

import re
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from acrc_testbed.testing import VirtualSwarm
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.loading import load_behaviour
from actors.robot.behaviour.node_host import ensembles_of, node_of
from cleaning.strategies import STRATEGIES, entry
from deeco.explain.command import main
from deeco.explain.knowledge_use import ComponentPart, ensemble_part, processes
from tests.cleaning.fakes import OPEN
from tests.documentation.markdown import MarkdownPage

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


def test_text(capsys: pytest.CaptureFixture[str]) -> None:
    assert explained(capsys, *PAIR) == (EXPLAINED / "robot.txt").read_text()


def test_mermaid_chart(capsys: pytest.CaptureFixture[str]) -> None:
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
    assert "written by" not in text, "there is no component whose fields to list"


def test_unresolved_accesses_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    text = explained(capsys, f"{HERE}:Riddle")
    assert "    unknown      writes of `replace(self, **tables)`\n" in text
    assert "The table may lack fields used by guess: see 'unknown' above.\n" in text


def test_a_module_stands_for_its_classes(capsys: pytest.CaptureFixture[str]) -> None:
    lines = explained(capsys, HERE).splitlines()
    told = [line.split(",")[0] for line in lines if re.match(r"\w+, an? (component|ensemble)", line)]
    assert told == ["CleaningRobot", "Idler", "Riddle", "DestinationAdoption", "Charging"]


DEFINES = f"{HERE} defines CleaningRobot, Idler, Riddle, DestinationAdoption, Charging"
WRONG = {
    "nowhere:Robot": (
        "module 'nowhere' not found; write it as in an import, such as examples.convoy, "
        "and start in the folder that contains it"
    ),
    f"{HERE}:Robott": f"{HERE} does not define 'Robott'; {DEFINES}",
    f"{HERE}:Cleaner": f"{HERE}:Cleaner is a role; name a component or an ensemble; {DEFINES}",
    f"{HERE}:Point": f"{HERE}:Point is a class without @component and @ensemble; {DEFINES}",
    f"{HERE}:ROBOT": (
        f"{HERE}:ROBOT is an instance of the component CleaningRobot; name its class; {DEFINES}"
    ),
    f"{HERE}:START": f"{HERE}:START is of type int, neither a component nor an ensemble; {DEFINES}",
    "deeco.instant": (
        "deeco.instant has no class with @component or @ensemble; name another module, or one of its classes"
    ),
    "examples.convoy:": (
        "'examples.convoy:' is not a valid name; write 'module:Component', 'module:Ensemble' or 'module'"
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
        "module 'needy' cannot be imported: 'nowhere_at_all' is not installed"
    )
    (tmp_path / "unsound.py").write_text("from deeco import on_change\non_change()\n")
    assert refused(capsys, "unsound") == "@on_change() has no fact; name one, such as Cleaner.is_blocked"


EXAMPLES = ("examples.courteous:behaviour",)
UNKNOWN = {
    # The oracle puts itself on a board that all robots of the process read, at any later time.
    ("oracle", "consult"): ("reads of self through `board.known[self.id]`",)
}
"""Expected unresolved accesses by strategy and process."""


def parts(strategy: str) -> tuple[ComponentPart, ...]:
    """Return the processes of a strategy's component and the ensembles that it runs with."""
    behaviour = VirtualSwarm(partial(load_behaviour, entry(strategy)), OPEN, {"r1": "a"})["r1"].behaviour
    node = node_of(behaviour)
    assert node is not None
    kind = type(node.knowledge("r1"))
    parts = [ensemble_part(type(one), kind) for one in ensembles_of(behaviour)]
    return processes(kind) + tuple(part for part in parts if part)


@pytest.mark.parametrize("strategy", [*STRATEGIES, *EXAMPLES])
def test_every_process_and_ensemble_is_analysed(strategy: str) -> None:
    found = parts(strategy)
    assert {(strategy, part.name): part.unknowns for part in found if part.unknowns} == {
        key: unknowns for key, unknowns in UNKNOWN.items() if key[0] == strategy
    }
    assert all(part.writes for part in found if part.name not in {"report_status", "PeerMask"})


@pytest.fixture
def tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    page = MarkdownPage(REPOSITORY / "docs" / "tutorial.md")
    text = next(block.text for block in page.blocks() if block.text.startswith("# my_study/yielding.py"))
    (tmp_path / "tutorial_yielding.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "tutorial_yielding"
    sys.modules.pop("tutorial_yielding", None)


def test_the_modules_by_name(capsys: pytest.CaptureFixture[str], tutorial: str) -> None:
    modules = {name.partition(":")[0] for name in (*STRATEGIES.values(), *EXAMPLES)}
    for module in sorted(modules | {tutorial, "examples.convoy"}):
        assert main([module]) == 0, capsys.readouterr().err
        assert main(["--mermaid", module]) == 0
        text = capsys.readouterr().out
        assert ("unknown" in text) is (module == "cleaning.strategies.oracle")
        assert ", a component\n" in text
