"""The site is built without a warning, needs no network, and says of the code what the code says."""

import re
from pathlib import Path

import pytest

import actors.robot.behaviour as robot
import deeco
from actors.installation.usage import OptionError
from command_line.documentation import commands, site
from command_line.documentation.markdown import pages

pytestmark = pytest.mark.filterwarnings("ignore:.*MystReferenceResolver.app")
OUTSIDE = re.compile(
    r"""<(?:script|img|iframe|source|audio|video)\b[^>]*?\bsrc=["'](?:https?:)?//"""
    r"""|<link\b[^>]*?\bhref=["'](?:https?:)?//|@import|url\(\s*["']?(?:https?:)?//"""
)
"""What a browser would fetch from elsewhere by itself; links that a reader may follow are none."""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Also shows that there is no warning, such as of a page in no table of contents: each is an error."""
    return site.build(tmp_path_factory.mktemp("docs") / "site").parent


def text(built: Path, name: str) -> str:
    return re.sub(r"<[^>]+>", "", (built / f"{name}.html").read_text(encoding="utf-8"))


def test_every_page_is_there(built: Path) -> None:
    names = [page.name.removesuffix(".md") for page in pages() if page.name.startswith("docs/")]
    assert [name for name in names if not (built / f"{name.removeprefix('docs/')}.html").is_file()] == []


def test_no_page_fetches_anything_from_elsewhere(built: Path) -> None:
    files = [path for path in built.rglob("*") if path.suffix in {".html", ".css", ".js", ".svg"}]
    assert len(files) > 60
    assert [str(path) for path in files if OUTSIDE.search(path.read_text(encoding="utf-8"))] == []


def test_what_leads_out_of_a_page_is_there(built: Path) -> None:
    """Whatever Sphinx has resolved, and what the pages of source files lead to."""
    missing = []
    for page in built.rglob("*.html"):
        for target in re.findall(r'(?:href|src)="([^"#?]+)', page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+:", target) and not (page.parent / target).exists():
                missing.append(f"{page.relative_to(built)}: {target}")
    assert missing == []


def test_every_command_and_all_its_options_are_on_the_page(built: Path) -> None:
    page = text(built, site.COMMANDS)
    for words, command in commands.tree().items():
        assert f"\n{words}#" in page.replace("¶", "#"), words
        for option in (option for one in command.params for option in one.opts if option.startswith("--")):
            assert option in page, f"{words} {option}"


def test_every_public_name_is_on_a_page(built: Path) -> None:
    for package, name in ((robot, "reference/robot"), (deeco, "reference/deeco")):
        page = text(built, name)
        assert [one for one in package.__all__ if f"{package.__name__}.{one}" not in page] == []


def test_the_home_page_leads_to_every_chapter(built: Path) -> None:
    page = text(built, site.HOME)
    for heading in ("Write an adaptation", "Deploy", "How true is it", "Reference", "Inside"):
        assert page.count(heading) >= 2, "as a heading, and in the navigation"


def test_a_site_replaces_a_site_and_nothing_else(built: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("ten years")
    with pytest.raises(OptionError, match="is there and no site; must be a new folder, or an earlier site"):
        site.build(tmp_path)
    site._check_out(built)
    assert (tmp_path / "thesis.tex").is_file()
