"""The site is built without a warning, needs no network, and says of the code what the code says."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import actors.robot.behaviour as robot
import deeco
from actors.installation.usage import OptionError
from command_line.documentation import commands, site
from command_line.documentation.markdown import pages

if TYPE_CHECKING:
    from tests.control.browser import Browser

pytestmark = pytest.mark.filterwarnings("ignore:.*MystReferenceResolver.app")
OUTSIDE = re.compile(
    r"""<(?:script|img|iframe|source|audio|video)\b[^>]*?\bsrc=["'](?:https?:)?//"""
    r"""|<link\b[^>]*?\bhref=["'](?:https?:)?//|@import|url\(\s*["']?(?:https?:)?//"""
)
"""What a browser would fetch from elsewhere by itself; links that a reader may follow are none."""
OUT_OF_SIGHT = """[...document.querySelectorAll('article *')].filter(one => {
  const box = one.getBoundingClientRect();
  if (!box.width || box.right <= 391) return false;
  for (let around = one; around !== document.body; around = around.parentElement)
    if (['auto', 'scroll'].includes(getComputedStyle(around).overflowX)) return false;
  return true;
}).map(one => one.outerHTML.slice(0, 60))"""
"""What lies beyond the right edge of a phone, and in nothing that scrolls."""
SCROLLING = """[...document.querySelectorAll('pre')].filter(
  one => one.scrollWidth > one.clientWidth && getComputedStyle(one).overflowX == 'auto'
).length"""
"""Blocks of code that are wider than they are shown."""


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


def typed(browser: "Browser", words: str) -> None:
    for letter in words:
        browser.press(letter)


def test_typing_finds_page_heading_and_the_words_marked_in_an_excerpt(
    built: Path, browser: "Browser"
) -> None:
    """From files alone, on a phone."""
    browser.open((built / "search.html").as_uri(), width=390, height=844)
    assert browser.value("document.activeElement.id") == "search-words"
    typed(browser, "Seals recordings")
    assert browser.value("document.getElementById('search-count').textContent").endswith(" places")
    first = "document.querySelector('#search-found li')"
    link = browser.value(f"{first}.querySelector('a').textContent")
    page, _, heading = link.partition(" / ")
    assert (page, heading) == ("16. Seals in recordings, and a digest that no robot can write", "")
    assert browser.value(f"{first}.querySelector('a').getAttribute('href')").startswith(
        "decisions/0016-seals.html#seals-in-recordings"
    )
    marked = browser.value(
        f"[...{first}.querySelectorAll('p mark')].map(one => one.textContent.toLowerCase())"
    )
    assert marked and set(marked) <= {"seals", "recordings"}
    headings = browser.value("[...document.querySelectorAll('#search-found a')].map(one => one.textContent)")
    assert any(" / " in one for one in headings)
    assert browser.value("document.documentElement.scrollWidth") <= 390
    typed(browser, " zzyzx")
    assert browser.value("document.getElementById('search-count').textContent") == "0 places"
    assert browser.value("document.getElementById('search-found').children.length") == 0


def test_the_search_needs_no_mouse(built: Path, browser: "Browser") -> None:
    browser.open((built / "radio.html").as_uri())
    browser.press("/")
    typed(browser, "digest <b>")
    browser.press("Enter")
    browser.until("document.getElementById('search-words').value == 'digest <b>'")
    browser.value("document.getElementById('search-words').value = ''")
    typed(browser, "dead reckoning")
    assert browser.value("document.querySelectorAll('#search-found b').length") == 0
    for key, place in (("ArrowDown", 0), ("ArrowDown", 1), ("ArrowUp", 0)):
        browser.press(key)
        there = f"document.querySelectorAll('#search-found a')[{place}] === document.activeElement"
        assert browser.value(there), (key, place)
    browser.press("Escape")
    assert browser.value("document.activeElement.id") == "search-words"
    leads = browser.value("document.querySelector('#search-found a').href")
    browser.press("Enter")
    browser.until(f"location.href == '{leads}' && document.readyState == 'complete'")
    assert browser.value("document.getElementById(decodeURIComponent(location.hash.slice(1))) !== null")


def test_on_a_phone_no_page_scrolls_sideways_and_blocks_of_code_do(built: Path, browser: "Browser") -> None:
    scrolling = 0
    for name in ("index", "experiments", "tutorial", "reference/commands", "how-true", "architecture"):
        browser.open((built / f"{name}.html").as_uri(), width=390, height=844)
        assert browser.value(OUT_OF_SIGHT) == [], name
        assert browser.value("document.documentElement.scrollWidth") <= 390, name
        scrolling += browser.value(SCROLLING)
    assert scrolling > 10


def test_a_site_replaces_a_site_and_nothing_else(built: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("ten years")
    with pytest.raises(OptionError, match="is there and no site; must be a new folder, or an earlier site"):
        site.build(tmp_path)
    site._check_out(built)
    assert (tmp_path / "thesis.tex").is_file()
