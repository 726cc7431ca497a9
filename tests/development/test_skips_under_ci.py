import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ONE_SKIPS = "import pytest\n\ndef test_runs(): pass\n\n@pytest.mark.skip\ndef test_does_not(): pass\n"


def run(folder: Path, ci: str | None, text: str) -> subprocess.CompletedProcess[str]:
    (folder / "test_some.py").write_text(text)
    environment = {name: value for name, value in os.environ.items() if name != "CI"}
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-c", os.devnull, "--rootdir", ".", "."],
        cwd=folder,
        env=environment
        | {"PYTHONPATH": str(ROOT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
        | ({} if ci is None else {"CI": ci}),
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("ci", "text", "code"),
    [
        ("true", ONE_SKIPS, 1),
        ("true", "import pytest\npytest.skip(allow_module_level=True)\n", 1),
        ("true", "import pytest\n\n@pytest.mark.xfail\ndef test_fails(): assert 0\n", 0),
        ("false", ONE_SKIPS, 0),
        (None, ONE_SKIPS, 0),
    ],
)
def test_a_skipped_test_is_a_failure_under_ci_only(
    tmp_path: Path, ci: str | None, text: str, code: int
) -> None:
    done = run(tmp_path, ci, text)
    # a module that skips leaves no test: pytest's own exit code for that is a failure as well
    assert bool(done.returncode) == bool(code)
    assert ("CI is set, so skipped tests are failures" in done.stdout) == bool(code)


def test_the_sentence_names_what_was_skipped(tmp_path: Path) -> None:
    lines = run(tmp_path, "true", ONE_SKIPS).stdout.splitlines()
    sentence = "CI is set, so skipped tests are failures; skipped: test_some.py::test_does_not"
    assert sentence in lines
    assert "1 passed, 1 skipped" in lines[-1]
