"""The Python of docs/authors.md: its modules load, and its tests of strategies pass."""

import importlib
import re
import sys
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from tests.documentation.markdown import MarkdownPage


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Write all Python files of the page and return the names of its test modules."""
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_study"]:
        monkeypatch.delitem(sys.modules, name)
    (tmp_path / "my_study").mkdir()
    names = []
    for block in MarkdownPage(REPOSITORY / "docs" / "authors.md").blocks():
        if block.language == "python":
            found = re.match(r"# my_study/(\w+)\.py\n", block.text)
            name = found[1] if found else f"part_{block.line}"
            (tmp_path / "my_study" / f"{name}.py").write_text(block.text)
            names.append(name)
    return names


def test_tests_on_the_page_pass(modules: list[str]) -> None:
    loaded = [importlib.import_module(f"my_study.{name}") for name in modules]
    tests = [test for one in loaded for name, test in vars(one).items() if name.startswith("test_")]
    for test in tests:
        test()
    assert len(tests) == 3
    for one in loaded:
        del sys.modules[one.__name__]
