"""The site is built without a warning, fetches nothing from elsewhere, and has every page and public name."""

import re
from pathlib import Path
from types import ModuleType

import pytest

import actors.robot.behaviour as robot
import deeco
from actors.installation.repository import REPOSITORY
from command_line import documentation
from tests.documentation.markdown import pages

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.filterwarnings("ignore:.*MystReferenceResolver.app"),
]
OUTSIDE = re.compile(
    r"""<(?:script|img|iframe|source|audio|video)\b[^>]*?\bsrc=["'](?:https?:)?//"""
    r"""|<link\b[^>]*?\bhref=["'](?:https?:)?//|@import|url\(\s*["']?(?:https?:)?//"""
)
"""What a browser would fetch from elsewhere by itself."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site; each warning of Sphinx would be an error, as of a page in no table of contents."""
    return documentation.build(REPOSITORY / "docs", tmp_path_factory.mktemp("docs") / "site").parent


def test_every_page_is_there_and_leads_to_files_of_the_site(site: Path) -> None:
    names = {page.name.removesuffix(".md") for page in pages() if page.name.startswith("docs/")}
    assert {name for name in names if not (site / f"{name.removeprefix('docs/')}.html").is_file()} == set()
    missing = []
    for page in site.rglob("*.html"):
        for target in re.findall(r'(?:href|src)="([^"#?]+)', page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+:", target) and not (page.parent / target).exists():
                missing.append(f"{page.relative_to(site)}: {target}")
    assert missing == []


def test_no_page_fetches_anything_from_elsewhere(site: Path) -> None:
    files = [path for path in site.rglob("*") if path.suffix in {".html", ".css", ".js", ".svg"}]
    assert len(files) > 60
    assert [str(path) for path in files if OUTSIDE.search(path.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize(("package", "name"), [(robot, "robot"), (deeco, "deeco")])
def test_every_public_name_is_in_the_reference(package: ModuleType, name: str, site: Path) -> None:
    page = (site / "reference" / f"{name}.html").read_text(encoding="utf-8")
    page = re.sub(r"<[^>]+>", "", page)
    assert [one for one in package.__all__ if f"{package.__name__}.{one}" not in page] == []
