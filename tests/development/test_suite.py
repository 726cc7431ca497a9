"""`acrc test`: two halves, one process for named tests, a limit on started processes; skips fail in CI."""

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from actors.installation.repository import PACKAGES, REPOSITORY
from command_line.development import suite as module
from command_line.development.suite import BUDGET, BY_FILE, ProcessCounter, run_suite

PASSES = "def test_passes(): pass\n"
MARKED = "import pytest\npytestmark = pytest.mark.alone\n" + PASSES


@pytest.fixture
def suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, list[list[str]]]]:
    """Return exit code and pytest's arguments for given exit codes of the two halves."""

    def run(*words: str, codes: tuple[int, ...] = (0, 0)) -> tuple[int, list[list[str]]]:
        calls: list[list[str]] = []
        (tmp_path / "test_a.py").write_text(PASSES)
        (tmp_path / "test_b.py").write_text(MARKED)

        def noted(root: Path, words: list[str]) -> int:
            calls.append(list(words))
            return codes[len(calls) - 1]

        monkeypatch.setattr("command_line.development.suite.os.cpu_count", lambda: 1)
        monkeypatch.setattr(module, "run_pytest", noted)
        return run_suite(tmp_path, words), calls

    return run


@pytest.mark.parametrize(
    ("codes", "code"), [((0, 0), 0), ((1, 0), 1), ((0, 1), 1), ((5, 0), 0), ((0, 5), 0), ((5, 5), 5)]
)
def test_both_halves_decide(
    suite: Callable[..., tuple[int, list[list[str]]]], codes: tuple[int, int], code: int
) -> None:
    halves = [
        ["-m", "not alone and not nightly", "-n", "2", *BY_FILE],
        ["-m", "alone and not nightly", "test_b.py"],
    ]
    assert suite(codes=codes) == (code, halves)


def test_arguments_select_one_process_or_the_nightly_tests(
    suite: Callable[..., tuple[int, list[list[str]]]],
) -> None:
    assert suite("-q", "test_a.py", codes=(3,)) == (3, [["-q", "test_a.py"]])
    _, (beside, alone) = suite("--nightly")
    assert beside[1] == "not alone" and alone[1] == "alone"


def test_a_suite_that_starts_too_many_processes_fails(
    suite: Callable[..., tuple[int, list[list[str]]]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / BUDGET).parent.mkdir(parents=True)
    (tmp_path / BUDGET).write_text("[suite]\nprocesses = 0\n")
    assert suite()[0] == 0
    (tmp_path / BUDGET).write_text("[suite]\nprocesses = -1\n")
    assert suite()[0] == 1
    assert capsys.readouterr().err.splitlines()[-1].endswith(f"were started; {BUDGET} allows -1")


def test_started_processes_are_counted_with_their_children() -> None:
    with ProcessCounter() as started:
        subprocess.run(["sh", "-c", "sleep 0.3 & sleep 0.3; wait"], check=True)
    assert started.count == 3


@pytest.mark.parametrize(("ci", "code"), [("true", 1), ("false", 0)])
def test_a_skipped_module_is_a_failure_under_ci(tmp_path: Path, ci: str, code: int) -> None:
    """The module is skipped in a worker of pytest-xdist, whose controller reports it."""
    (tmp_path / "test_gone.py").write_text("import pytest\npytest.skip('why', allow_module_level=True)\n")
    (tmp_path / "test_here.py").write_text(PASSES)
    words = ["-p", "tests.conftest", "-c", "/dev/null", "--rootdir", ".", "-n", "1", "."]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "CI": ci, "PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip
    assert done.returncode == code, done.stdout
    sentence = "CI is set, so skipped tests are failures; skipped: test_gone.py"
    assert (sentence in done.stdout.splitlines()) == bool(code)


PURE = {"abs", "all", "array", "array_equal", "int", "isinstance", "len", "reshape"}


def test_the_product_works_without_assertions_and_docstrings() -> None:
    """With -O and -OO they are gone."""
    wrong = []
    for path in (path for name in PACKAGES for path in (REPOSITORY / name).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            parts = list(ast.walk(node)) if isinstance(node, ast.Assert) else []
            calls = {ast.unparse(one.func).rpartition(".")[2] for one in parts if isinstance(one, ast.Call)}
            effects = ast.NamedExpr | ast.Await | ast.Yield | ast.YieldFrom
            if any(isinstance(one, effects) for one in parts) or calls - PURE:
                wrong.append(f"{path}:{getattr(node, 'lineno', 0)}")
            if isinstance(node, ast.Attribute) and node.attr == "__doc__":
                wrong.append(f"{path}:{node.lineno}")
    assert wrong == []
