"""`acrc test` runs the suite in two halves, and what is wrong in either is the command's exit code."""

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from actors.installation.repository import PACKAGES
from command_line.development.suite import BY_FILE, run_suite
from tests.conftest import LONGEST

PASSES = "def test_passes(): pass\n"
FAILS = "def test_fails(): assert 0\n"
CRASHES = "import os\ndef test_crashes(): os._exit(3)\n"
MARKED = "import pytest\npytestmark = pytest.mark.alone\n"
MORE = "import pytest\npytestmark = pytest.mark.nightly\n"
SETTINGS = """[pytest]
markers =
    alone: nothing runs beside it
    nightly: more seeds
addopts = --strict-markers -p xdist
"""


@pytest.fixture
def suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, list[list[str]]]]:
    """Runs a suite of these files as on one core: the exit code, and what pytest was told."""

    def suite_of(*words: str, **files: str) -> tuple[int, list[list[str]]]:
        (tmp_path / "pytest.ini").write_text(SETTINGS)
        for name, text in files.items():
            (tmp_path / f"{name}.py").write_text(text)
        calls: list[list[str]] = []

        def noted(command: list[str], **settings: object) -> subprocess.CompletedProcess[bytes]:
            calls.append(command[3:])
            return run(command, stdout=subprocess.DEVNULL, **settings)  # type: ignore[call-overload,no-any-return]

        run = subprocess.run
        monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # each of a run's processes would load all
        monkeypatch.setattr("command_line.development.suite.os.cpu_count", lambda: 1)
        monkeypatch.setattr("command_line.development.suite.subprocess.run", noted)
        return run_suite(tmp_path, words), calls

    return suite_of


@pytest.mark.parametrize(
    ("files", "code"),
    [
        ({"test_a": PASSES, "test_b": MARKED + PASSES}, 0),
        ({"test_a": FAILS, "test_b": MARKED + PASSES}, 1),
        ({"test_a": PASSES, "test_b": MARKED + FAILS}, 1),
        ({"test_a": PASSES}, 0),
        ({"test_b": MARKED + PASSES}, 0),
        ({"nothing": ""}, 5),
    ],
)
def test_both_halves_decide(
    suite: Callable[..., tuple[int, list[list[str]]]], files: dict[str, str], code: int
) -> None:
    marked = [f"{name}.py" for name, text in files.items() if text.startswith(MARKED)]
    assert suite(**files) == (
        code,
        [
            ["-m", "not alone and not nightly", "-n", "2", *BY_FILE],
            ["-m", "alone and not nightly", *marked],
        ],
    )


@pytest.mark.timeout(60)
def test_a_worker_that_crashes_ends_its_half_and_keeps_nobody_waiting(
    suite: Callable[..., tuple[int, list[list[str]]]],
) -> None:
    files = {f"test_{letter}": PASSES for letter in "bcdefgh"}
    code, calls = suite(test_a=PASSES, test_i=CRASHES, **files)
    assert (code, len(calls)) == (1, 2)


def test_a_marker_from_another_file_is_refused(tmp_path: Path) -> None:
    """The second half would not find it."""
    (tmp_path / "marks.py").write_text(MARKED)
    (tmp_path / "test_own.py").write_text("from marks import pytestmark\n" + PASSES)
    words = ["-p", "tests.conftest", "-c", "/dev/null", "--rootdir", ".", "."]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
    )  # fmt: skip
    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert "test_own.py::test_passes: the marker alone must stand in the test's own file" in done.stderr


@pytest.mark.parametrize(("words", "code"), [((), 0), (("--nightly",), 1)])
@pytest.mark.parametrize(
    "failing", [MORE + FAILS, MARKED + "pytestmark = [pytestmark, pytest.mark.nightly]\n" + FAILS]
)
def test_what_is_left_to_the_night_runs_when_asked_for(
    suite: Callable[..., tuple[int, list[list[str]]]], failing: str, words: tuple[str, ...], code: int
) -> None:
    assert suite(*words, test_a=PASSES, test_b=MARKED + PASSES, test_c=failing)[0] == code


def test_modules_are_compiled_once_for_all_that_the_tests_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "helping.py").write_text("")
    (tmp_path / "test_own.py").write_text("def test_it(): import helping\n")
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.delenv("PYTHONPYCACHEPREFIX", raising=False)
    assert run_suite(tmp_path, ("-q", "test_own.py")) == 0
    assert list(tmp_path.glob("__pycache__/helping.*.pyc")) != []


def test_what_is_to_begin_first_is_there() -> None:
    tests = Path(__file__).parents[1]
    assert [name for name in LONGEST if not (tests / name).is_file()] == []


def test_whoever_names_tests_gets_one_process(tmp_path: Path) -> None:
    (tmp_path / "test_own.py").write_text("def test_it(worker_id='none'): assert worker_id == 'none'\n")
    assert run_suite(tmp_path, ("-q", "test_own.py")) == 0


def test_under_ci_a_module_skipped_in_a_worker_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(__file__).parents[2]
    (tmp_path / "test_gone.py").write_text("import pytest\npytest.skip('why', allow_module_level=True)\n")
    (tmp_path / "test_here.py").write_text(PASSES)
    monkeypatch.setenv("CI", "true")
    monkeypatch.setenv("PYTHONPATH", str(root))
    words = ["-p", "tests.conftest", "-c", "/dev/null", "--rootdir", ".", "-n", "2", "."]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "CI is set, so skipped tests are failures; skipped: test_gone.py" in done.stdout.splitlines()


PURE = {"abs", "all", "array", "array_equal", "int", "isinstance", "len", "reshape"}


def test_the_product_works_without_assertions_and_docstrings() -> None:
    """With -O and -OO they are gone."""
    root, wrong = Path(__file__).parents[2], []
    for path in (path for name in PACKAGES for path in (root / name).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            parts = list(ast.walk(node)) if isinstance(node, ast.Assert) else []
            calls = {ast.unparse(one.func).rpartition(".")[2] for one in parts if isinstance(one, ast.Call)}
            effects = ast.NamedExpr | ast.Await | ast.Yield | ast.YieldFrom
            if any(isinstance(one, effects) for one in parts) or calls - PURE:
                wrong.append(f"{path}:{getattr(node, 'lineno', 0)}")
            if isinstance(node, ast.Attribute) and node.attr == "__doc__":
                wrong.append(f"{path}:{node.lineno}")
    assert wrong == []
