"""The convoy closes up by radio, and by nothing else."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from examples.convoy import drive

ROOT = Path(__file__).parents[2]
ALONE = [60.0 + 2.0 * 120 - 9.0, 45.0, 95.0]
"""After two minutes without news, m: the leader drives at 10 m/s and the others at 8, which they reach from
rest at 2 m/s²; on the way there it loses 25 m and they 16."""


@pytest.mark.parametrize("seed", [0, 3])
def test_the_gaps_converge(seed: int) -> None:
    rows = list(drive(seed=seed))
    assert len(rows) == 12
    # In the last half minute, with a fifth of the frames lost: within 5 cm.
    assert rows[-4:] == [pytest.approx([20.0, 20.0, 20.0], abs=0.05)] * 4
    assert min(gap for row in rows for gap in row) > 19.9, "nobody came nearer than that on the way"


@pytest.mark.parametrize("off", [{"loss": 1.0}, {"reach": 0.0}], ids=str)
def test_without_radio_they_do_not(off: dict[str, float]) -> None:
    last = list(drive(**off))[-1]  # type: ignore[arg-type]  # none of them is the seed
    assert last == pytest.approx(ALONE, abs=0.2)  # motion goes in steps of 0.1 s


def test_out_of_reach_of_the_radio_only_those_in_reach_close_up() -> None:
    last = list(drive(reach=70.0))[-1]
    assert last[:2] == pytest.approx([20.0, 20.0], abs=0.05)
    assert last[2] > 95.0


def test_the_same_seed_gives_the_same_drive_and_another_one_does_not() -> None:
    assert list(drive(seed=3)) == list(drive(seed=3))
    assert list(drive(seed=3)) != list(drive(seed=4))


def test_as_a_newcomer_runs_it() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "examples.convoy"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    lines = run.stdout.splitlines()
    assert len(lines) == 12
    assert lines[0].startswith("  10 s")
    assert lines[-1] == " 120 s     20.0 m     20.0 m     20.0 m"


def test_it_imports_the_component_model_and_python_only() -> None:
    tree = ast.parse((ROOT / "examples" / "convoy.py").read_text())
    imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    imported |= {
        alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
    }
    assert {name.partition(".")[0] for name in imported} - sys.stdlib_module_names == {"deeco"}
