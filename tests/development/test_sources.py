"""Rules for the sources: class names, calls, assertions, types, arithmetic of cores, size."""

import ast
import os
import shutil
import subprocess
import sys
import tomllib
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from acrc_testbed.command_line.portability import findings, findings_in
from actors.installation.repository import PACKAGES, REPOSITORY
from tests.development.budget import FILE, as_toml, measure, tokens

MOST_POSITIONAL = 7
PURE = {"abs", "all", "array", "array_equal", "int", "isinstance", "len", "reshape"}
SLACK = 0.03
"""Share by which a count may be below its limit before the limit must be lowered."""
HEAD = "import math\nimport numpy as np\n"
MISTAKEN = """
from actors.robot.behaviour import Behaviour, Start, host
from cleaning import CleaningRobot, assignments
from deeco import seconds

PERIOD: str = seconds(0.5)


def behaviour(start: Start) -> Behaviour:
    robot = CleaningRobot(id=start.address, position=start.pose.point, route=assignments(start))
    return host(start, robot)
"""


@cache
def nodes() -> list[tuple[Path, list[ast.AST]]]:
    """Return the syntax nodes of each module of the product."""
    files = [file for package in (*PACKAGES, "maps") for file in (REPOSITORY / package).rglob("*.py")]
    return [(file.relative_to(REPOSITORY), list(ast.walk(ast.parse(file.read_text())))) for file in files]


def test_class_names_are_unique_and_calls_with_many_values_name_them() -> None:
    classes, calls = defaultdict[str, list[str]](list), []
    for file, found in nodes():
        for node in (one for one in found if isinstance(one, ast.ClassDef)):
            classes[node.name].append(f"{file}:{node.lineno}")
    assert not {name: places for name, places in classes.items() if len(places) > 1}
    for file, found in nodes():
        for call in (one for one in found if isinstance(one, ast.Call) and isinstance(one.func, ast.Name)):
            given = sum(not isinstance(argument, ast.Starred) for argument in call.args)
            if ast.unparse(call.func) in classes and given > MOST_POSITIONAL:
                calls.append(f"{file}:{call.lineno}: {ast.unparse(call.func)} from {given} values; name them")
    assert not calls, "\n".join(calls)


def test_the_product_works_without_assertions_and_docstrings() -> None:
    """Check that -O and -OO, which remove them, change nothing."""
    wrong = []
    effects = ast.NamedExpr | ast.Await | ast.Yield | ast.YieldFrom
    for path, found in nodes():
        for node in found:
            parts = list(ast.walk(node)) if isinstance(node, ast.Assert) else []
            calls = {ast.unparse(one.func).rpartition(".")[2] for one in parts if isinstance(one, ast.Call)}
            documented = isinstance(node, ast.Attribute) and node.attr == "__doc__"
            if documented or any(isinstance(one, effects) for one in parts) or calls - PURE:
                wrong.append(f"{path}:{getattr(node, 'lineno', 0)}")
    assert wrong == []


@pytest.mark.nightly
def test_mypy_checks_a_strategy_in_any_folder(tmp_path: Path) -> None:
    shutil.copy(REPOSITORY / "examples" / "courteous.py", tmp_path / "mine.py")
    (tmp_path / "mistaken.py").write_text(MISTAKEN)
    words = ["--strict", "--config-file=", "--no-pretty", "mine.py", "mistaken.py"]
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # leads to the clone
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *words],
        cwd=tmp_path, env=env, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stderr == ""
    assert done.stdout.splitlines() == [
        'mistaken.py:6: error: Incompatible types in assignment (expression has type "Duration", '
        'variable has type "str")  [assignment]',
        'mistaken.py:10: error: Argument "id" to "CleaningRobot" has incompatible type "int"; '
        'expected "str"  [arg-type]',
        "Found 2 errors in 1 file (checked 2 source files)",
    ]


def test_every_package_is_marked_as_typed() -> None:
    assert {path.parent.name for path in REPOSITORY.glob("*/py.typed")} == PACKAGES


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
    (found,) = findings_in(HEAD + line + "\n", "actors/world/x.py")
    assert str(found).startswith(f"actors/world/x.py:3: {problem}")


def test_portable_operations_are_accepted_and_cores_have_no_others() -> None:
    lines = """
x = math.sqrt(y) + np.cumsum(a) - np.maximum(b, 0) + counts.sum(dtype=np.int64) + 2**64
x = sum(len(row) for row in rows) + sum(int(a) for a in b) + sum(a == b for a in c)
x = generator.random(3) + np.argsort(y, kind="stable") + Fraction(1, 2) ** 2
"""
    assert findings_in(HEAD + lines, "actors/world/x.py") == []
    assert findings() == []


def test_only_packages_with_cores_are_checked_and_ruff_bans_functions_there(tmp_path: Path) -> None:
    for name in ("actors/world/a.py", "actors/observer/b.py", "deploy/c.py", "cleaning/d.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("import math\n\nX = math.exp(1) ** 2\n")
    cores = ["actors/world/a.py", "cleaning/d.py"]
    assert [one.path for one in findings(tmp_path)] == cores
    shutil.copy(REPOSITORY / "pyproject.toml", tmp_path)
    command = [sys.executable, "-m", "ruff", "check", "--select", "TID251", "--output-format", "concise"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    banned = [line for line in done.stdout.splitlines() if "`math.exp` is banned" in line]
    assert sorted(line.partition(":")[0] for line in banned) == cores


def test_size_is_within_its_budget() -> None:
    measured, budget = measure(), tomllib.loads(FILE.read_text())
    wrong = [
        f"[{table}] {name}: {count}, the budget is {limit}; write {name} = {count} only if it goes down"
        for table in ("tokens", "modules")
        for name in sorted({*measured[table], *budget[table]})
        for count, limit in ((measured[table].get(name, 0), budget[table].get(name, 0)),)
        if count > limit or count < (1 - SLACK) * limit
    ]
    assert not wrong, "\n".join(wrong)


def test_tokens_are_counted_without_comments_docstrings_and_layout() -> None:
    assert tokens('"""A module."""\n\ndef f(x):  # comment\n    """Doc."""\n    return x + "s"\n') == 10
    assert as_toml({"suite": {"processes": 7}}).endswith("\n\n[suite]\nprocesses = 7\n")
