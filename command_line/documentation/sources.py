"""Links from pages to other files of the repository: on the site these have pages, too, with their text."""

import ast
import html
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

from actors.installation.repository import REPOSITORY

_KIND: Final = "repository"
_LANGUAGES: Final = {".py": "python", ".toml": "toml", ".yaml": "yaml", ".json": "json"}


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("doctree-read", _mark, priority=400)  # before Sphinx makes downloads of them
    app.connect("missing-reference", _resolve)
    app.connect("html-collect-pages", _pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _mark(app: Sphinx, tree: nodes.document) -> None:
    """Links to files and folders outside of docs/ become references that `_resolve` knows."""
    folder = Path(app.env.doc2path(app.env.docname)).parent
    for node in list(
        tree.findall(lambda one: isinstance(one, addnodes.download_reference | addnodes.pending_xref))
    ):
        if node.get("reftype") != "myst" or node.get("refdomain"):
            continue
        path = (folder / node["reftarget"]).resolve()
        if path.exists() and path.is_relative_to(REPOSITORY):
            target = path.relative_to(REPOSITORY).as_posix()
            reference = addnodes.pending_xref(
                "", *node.children, refdomain="", reftype=_KIND, reftarget=target, refdoc=app.env.docname
            )
            node.replace_self(reference)


def _resolve(app: Sphinx, env: Any, node: addnodes.pending_xref, content: nodes.Element) -> nodes.Node | None:
    if node["reftype"] != _KIND:
        return None
    _linked(env).add(node["reftarget"])
    uri = app.builder.get_relative_uri(node["refdoc"], _page(node["reftarget"]))
    return nodes.reference("", "", content, internal=True, refuri=uri)


def _linked(env: Any) -> set[str]:
    """What pages lead to."""
    if not hasattr(env, "acrc_linked"):
        env.acrc_linked = set()
    found: set[str] = env.acrc_linked
    return found


def _page(target: str) -> str:
    return f"source/{target}"


def _pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """A page for each file that is linked, and for each folder with the files in it."""
    linked = {REPOSITORY / target for target in _linked(app.env)}
    inside = {path for folder in linked if folder.is_dir() for path in folder.glob("*.py")}
    for path in sorted(linked | inside):
        name = path.relative_to(REPOSITORY).as_posix()
        body = _folder(path) if path.is_dir() else _file(app, path)
        yield (
            _page(name),
            {"title": name, "body": f"<h1>{html.escape(name)}</h1>{body}", "parents": []},
            "page.html",
        )


def _file(app: Sphinx, path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    language = _LANGUAGES.get(path.suffix, "text")
    highlighted: str = app.builder.highlighter.highlight_block(text, language)  # type: ignore[attr-defined]
    return highlighted


def _folder(path: Path) -> str:
    rows = "".join(
        f'<li><a href="{path.name}/{file.name}.html"><code>{file.name}</code></a>: '
        f"{html.escape(_first_line(file))}</li>"
        for file in sorted(path.glob("*.py"))
    )
    return f"<ul>{rows}</ul>"


def _first_line(file: Path) -> str:
    words = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return words.partition("\n")[0]
