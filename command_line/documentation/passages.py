"""What the site's search looks through: every heading with the text below it, as a script beside the pages.

A browser lets no page of a folder fetch a file, but any page may load a script.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

_FILE: Final = Path("_static", "passages.js")
_UNREAD: Final = (nodes.comment, nodes.raw, addnodes.toctree, nodes.title, addnodes.desc_signature)
"""What is no text of a passage: it is not shown, or it is the heading."""


class Passage(NamedTuple):
    """A heading, and what stands below it up to the next one."""

    page: str
    heading: str
    address: str
    """Seen from the root of the site."""
    text: str


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx, error: Exception | None) -> None:
    if error is None:
        found = [list(one) for name in sorted(app.env.found_docs) for one in _passages(app, name)]
        script = f"const PASSAGES = {json.dumps(found, ensure_ascii=False)};\n"
        (Path(app.outdir) / _FILE).write_text(script, encoding="utf-8")


def _passages(app: Sphinx, name: str) -> Iterator[Passage]:
    """Of one page, in its order."""
    tree, address = app.env.get_doctree(name), app.builder.get_target_uri(name)
    page = app.env.titles[name].astext()
    for part in tree.findall(lambda node: isinstance(node, nodes.section | addnodes.desc)):
        if (headed := _heading(part)) is not None:
            anchor, heading = headed
            yield Passage(page, heading, f"{address}#{anchor}", " ".join(_words(part)))


def _heading(part: Any) -> tuple[str, str] | None:
    """Its anchor and its words: of a section, or of a name that is described; None where it has no anchor."""
    for child in part.children:
        if isinstance(child, nodes.title) and part["ids"]:
            return part["ids"][0], child.astext()
        if isinstance(child, addnodes.desc_signature) and child["ids"]:
            return child["ids"][0], child["fullname"] if child.get("fullname") else child.astext()
    return None


def _words(part: nodes.Element) -> Iterator[str]:
    """The words below a heading, but for those below another one."""
    for child in part.children:
        if isinstance(child, _UNREAD) or (isinstance(child, nodes.Element) and _heading(child) is not None):
            continue
        if isinstance(child, nodes.Text):
            yield from child.split()
        elif isinstance(child, nodes.TextElement):
            yield from child.astext().split()
        elif isinstance(child, nodes.Element):
            yield from _words(child)
