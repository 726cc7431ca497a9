"""The shared short run, under the names that the tests of this folder use."""

from pathlib import Path

import pytest


@pytest.fixture
def recorded(short_run: Path) -> Path:
    return short_run


@pytest.fixture
def copy(short_run_copy: Path) -> Path:
    return short_run_copy
