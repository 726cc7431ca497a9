"""`python -m deeco.explain` tells everything of the shipped strategies, the examples and the tutorial."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from actors.geometry import Point, Pose
from actors.installation.repository import REPOSITORY
from actors.robot.behaviour import Start
from actors.robot.behaviour.entry import load_behaviour
from actors.robot.behaviour.node_host import ensembles_of, node_of
from cleaning.strategies import STRATEGIES, entry
from deeco.explain.anatomy import ComponentPart, meeting, processes
from deeco.explain.command import main
from tests.cleaning.equipment import Floor
from tests.documentation.markdown import MarkdownPage

EXAMPLES = ("examples.courteous:behaviour",)
UNKNOWN = {
    # The oracle puts itself on a board that all robots of the process read, at any later time.
    ("oracle", "consult"): ("what is read of self by way of `board.known[self.id]`",)
}
"""What remains untold, by strategy and process, and why."""


def parts(strategy: str) -> tuple[ComponentPart, ...]:
    """The processes of a strategy's component and the ensembles that it runs with."""
    generator = np.random.default_rng(1)
    start = Start("r1", 1, 0, Pose(0.0, 0.0, 0.0), (Point(1.0, 0.0),), generator, floor=Floor())
    behaviour = load_behaviour(entry(strategy), start)
    node = node_of(behaviour)
    assert node is not None
    kind = type(node.knowledge("r1"))
    met = [meeting(type(one), kind) for one in ensembles_of(behaviour)]
    return processes(kind) + tuple(part for part in met if part)


@pytest.mark.parametrize("strategy", [*STRATEGIES, *EXAMPLES])
def test_every_process_and_ensemble_is_told(strategy: str) -> None:
    found = parts(strategy)
    assert {(strategy, part.name): part.doubts for part in found if part.doubts} == {
        key: doubts for key, doubts in UNKNOWN.items() if key[0] == strategy
    }
    assert all(part.writes for part in found if part.name not in {"report_status", "PeerMask"})


@pytest.mark.parametrize(
    ("strategy", "part", "reads", "writes"),
    [
        ("none", "sense", set(), {"position"}),
        ("chapter", "detect_blocked", {"parameters", "waypoint", "destination", "position", "before",
                                       "still_for"}, {"before", "still_for", "state"}),
        ("auction", "leave_door", {"waypoint", "destination", "position", "attempt"},
         {"waypoint", "attempt"}),
        ("chapter-careful", "mind_pose", {"parameters", "lost_since", "trusts_until", "attempt", "looked"},
         {"lost_since", "looked", "attempt", "trusts_until", "state", "still_for", "blocked_for"}),
        ("examples.courteous:behaviour", "reorder", {"position", "route"}, {"route", "offered"}),
        ("examples.courteous:behaviour", "GivingWay",
         {"state", "position", "waits_until", "parameters", "attempt"},
         {"waypoint", "waits_until", "attempt"}),
    ],
)  # fmt: skip
def test_what_is_read_and_written(strategy: str, part: str, reads: set[str], writes: set[str]) -> None:
    (found,) = (one for one in parts(strategy) if one.name == part)
    assert set(found.reads) == reads
    assert writes <= set(found.writes)


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
        assert ("cannot tell" in text) is (module == "cleaning.strategies.oracle")
        assert ", a component\n" in text
