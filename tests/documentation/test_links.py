"""Links between the files of the repository, as a code host shows them: files and headings are there."""

import pytest

from actors.installation.repository import REPOSITORY
from command_line.documentation.contents import as_toctrees, chapters
from command_line.documentation.markdown import MarkdownPage, pages

PAGES = {page.name: page for page in pages()}


@pytest.mark.parametrize("name", PAGES)
def test_every_link_leads_somewhere(name: str) -> None:
    page = PAGES[name]
    wrong = []
    for link in page.links():
        if not link.is_local:
            continue
        file, _, anchor = link.target.partition("#")
        path = (page.path.parent / file).resolve() if file else page.path
        if not path.exists() or not path.is_relative_to(REPOSITORY):
            wrong.append(link.target)
        elif anchor and anchor not in MarkdownPage(path).anchors():
            wrong.append(f"{link.target}: no such heading")
    assert wrong == []


def test_a_link_without_an_end_is_found(tmp_path_factory: pytest.TempPathFactory) -> None:
    page = PAGES["docs/radio.md"]
    assert {"words", "what-is-not-modelled", "against-a-formula-and-against-ns-3"} <= page.anchors()
    assert "walls-1" not in page.anchors()


def test_the_contents_are_the_lists_of_the_home_page() -> None:
    home = PAGES["docs/index.md"]
    found = chapters(home)
    assert list(found)[:2] == ["Start here", "Write an adaptation"]
    assert found["Write an adaptation"] == ["tutorial.md", "deeco.md", "authors.md", "strategies.md"]
    assert "\n:caption: Deploy\n\ndeployment.md\n" in as_toctrees(home)


def test_every_page_is_in_the_contents_once() -> None:
    named = [name for names in chapters(PAGES["docs/index.md"]).values() for name in names]
    assert len(set(named)) == len(named)
    own = {name.removeprefix("docs/") for name in PAGES if not name.startswith("docs/decisions/0")}
    assert own - set(named) == {"README.md", "CONTRIBUTING.md", "SECURITY.md", "index.md"}
