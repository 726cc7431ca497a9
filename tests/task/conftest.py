"""Permission to load the tasks of tests."""

from collections.abc import Iterator

import pytest

from actors.installation.repository import REPOSITORY
from actors.task.loading import load_task
from actors.user_code import FINDER, set_task_folders


@pytest.fixture(autouse=True)
def task_folders() -> Iterator[None]:
    """Tasks may be in this repository, as with `--modules .`."""
    folders = FINDER.task_folders
    set_task_folders((REPOSITORY,))
    yield
    set_task_folders(folders)
    load_task.cache_clear()
