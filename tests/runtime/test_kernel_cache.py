"""Compiled kernels belong to one state of the sources: a change anywhere leads to another cache."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import actors


def cache_of(folder: Path) -> str:
    """The cache that a process uses whose `actors` lies in `folder`."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-P", "-S", "-c", "import actors, os; print(os.environ['NUMBA_CACHE_DIR'])"],
        env=environment | {"PYTHONPATH": str(folder)},  # and no installed `actors`, which would come first
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_a_change_of_any_source_leads_to_another_cache(tmp_path: Path) -> None:
    package = tmp_path / "actors"
    (package / "deep").mkdir(parents=True)
    shutil.copy(str(actors.__file__), package)
    kernel = package / "deep" / "kernel.py"
    kernel.write_text("ONE = 1\n")
    first = cache_of(tmp_path)
    assert first.startswith(str(package / "__pycache__" / "kernels-"))
    assert cache_of(tmp_path) == first
    kernel.write_text("ONE = 2\n")
    assert cache_of(tmp_path) != first
    kernel.write_text("ONE = 1\n")
    assert cache_of(tmp_path) == first
