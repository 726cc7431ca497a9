"""The check of arithmetic in cores finds each kind of operation whose result depends on the processor."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from command_line.development.portability import findings, in_source

HEAD = "import math\nimport numpy as np\n"


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("x = (a * b).mean()", ".mean() adds in an order"),
        ("x = a @ b", "@ adds in an order"),
        ("x = y**0.5", "** is the C library's power function"),
        ("x **= 2", "** is the C library's power function"),
        ("x = pow(2.0, 3)", "pow() is the C library's power function"),
        ("x = sum(a * b for a, b in c)", "sum() of floats compensates from Python 3.12 on"),
        ("x = rng.standard_normal(3)", ".standard_normal() draws through the C library"),
        ("x = np.argsort(y)", "argsort orders equal elements by processor"),
        ("@njit(fastmath=True)\ndef f(x): return x", "fastmath and parallel let the compiler reorder"),
    ],
)
def test_operations_that_depend_on_the_processor_are_found(line: str, problem: str) -> None:
    (found,) = in_source(HEAD + line + "\n", "actors/world/x.py")
    assert str(found).startswith(f"actors/world/x.py:3: {problem}")


def test_portable_operations_are_accepted() -> None:
    lines = """
x = math.sqrt(y) + np.cumsum(a) - np.maximum(b, 0) + counts.sum(dtype=np.int64) + 2**64
x = sum(len(row) for row in rows) + sum(int(a) for a in b) + sum(a == b for a in c)
x = generator.random(3) + np.argsort(y, kind="stable") + Fraction(1, 2) ** 2
"""
    assert in_source(HEAD + lines, "actors/world/x.py") == []


def test_no_core_of_the_product_has_any() -> None:
    assert findings() == []


def test_only_packages_with_cores_are_checked_and_ruff_bans_functions_there(tmp_path: Path) -> None:
    text = "import math\n\nX = math.exp(1) ** 2\n"
    for name in ("actors/world/a.py", "actors/observer/b.py", "deploy/c.py", "cleaning/d.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    cores = ["actors/world/a.py", "cleaning/d.py"]
    assert [one.path for one in findings(tmp_path)] == cores
    shutil.copy(REPOSITORY / "pyproject.toml", tmp_path)
    command = [sys.executable, "-m", "ruff", "check", "--select", "TID251", "--output-format", "concise"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    banned = [line for line in done.stdout.splitlines() if "`math.exp` is banned" in line]
    assert sorted(line.partition(":")[0] for line in banned) == cores
