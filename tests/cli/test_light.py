"""What only lists or helps imports nothing that only runs need."""

import subprocess
import sys

import pytest

HEAVY = ("distributed", "matplotlib", "numba", "pyarrow", "pymunk", "rerun", "scipy", "zenoh")


@pytest.mark.parametrize("words", ["list strategies", "--help", "run --help"])
def test_a_command_that_computes_nothing_imports_no_heavy_package(words: str) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-P", "-m", "command_line", *words.split()],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "command_line.app" in imported
    assert not imported.intersection(HEAVY)
