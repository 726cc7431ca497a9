"""The site: docs/ with a navigation, a reference of code and command line, and the files that it names."""

import io
import re
import shutil
from pathlib import Path
from typing import Any, Final

from sphinx.application import Sphinx
from sphinx.errors import SphinxError

from actors.installation import version
from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from actors.processes.scratch import scratch_folder
from actors.runtime.errors import AcrcError
from command_line.documentation import commands, contents
from command_line.documentation.markdown import MarkdownPage

DOCS: Final = REPOSITORY / "docs"
HOME: Final = "index"
COMMANDS: Final = "reference/commands"
"""The page that is made here."""
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*m")
_SETTINGS: Final[dict[str, Any]] = {
    "project": "ACRC testbed",
    "extensions": [
        "myst_parser",
        "sphinx.ext.autodoc",
        "command_line.documentation.sources",
        "command_line.documentation.passages",
        "command_line.documentation.site",
    ],
    "templates_path": [str(Path(__file__).parent / "templates")],
    "root_doc": HOME,
    "html_theme": "furo",
    "html_title": "ACRC testbed",
    "html_show_sphinx": False,
    "html_show_copyright": False,
    "html_show_sourcelink": False,
    "html_copy_source": False,
    "html_static_path": [str(Path(__file__).parent / "static")],
    "html_css_files": ["site.css"],
    "html_js_files": ["search.js"],
    "myst_heading_anchors": 4,
    "myst_enable_extensions": ["attrs_block"],
    "default_role": "code",
    "autodoc_member_order": "bysource",
    "autodoc_preserve_defaults": True,
    "autodoc_typehints_format": "short",
    "python_use_unqualified_type_names": True,
    "autodoc_default_options": {"members": True, "undoc-members": True},
    "smartquotes": False,
}


class DocumentationError(AcrcError):
    """A page is wrong."""


def build(out: Path) -> Path:
    """Write the site into the folder `out` and return its home page.

    Raises DocumentationError with every warning, OptionError where `out` holds something else.
    """
    _check_out(out)
    file = DOCS / f"{COMMANDS}.md"
    if file.read_text() != (page := commands.as_markdown()):
        file.write_text(page)
    said = io.StringIO()
    with scratch_folder() as scratch:
        fresh = scratch / "site"
        overrides = {**_SETTINGS, "release": version.release()}
        try:
            app = Sphinx(
                DOCS, None, fresh, scratch / "trees", "html", overrides,
                status=None, warning=said, freshenv=True,
            )  # fmt: skip
            app.build()
        except SphinxError as error:
            raise DocumentationError(f"docs: {error}") from None
        if said.getvalue():
            raise DocumentationError(f"docs: {_COLOURS.sub('', said.getvalue()).strip()}")
        if out.exists():
            shutil.rmtree(out)
        shutil.copytree(fresh, out)
    return (out / "index.html").resolve()


def _check_out(out: Path) -> None:
    """Raise OptionError unless there is nothing in the folder but a site."""
    if out.exists() and (not out.is_dir() or (any(out.iterdir()) and not (out / "objects.inv").is_file())):
        raise OptionError(f"--out: {out} is there and no site; must be a new folder, or an earlier site")


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx, which reads this module as an extension."""
    app.connect("source-read", _complete)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _complete(app: Sphinx, name: str, source: list[str]) -> None:
    """Add to the pages what is made from elsewhere."""
    page = MarkdownPage(Path(app.env.doc2path(name)))
    text = page.text
    if name == HOME:
        text += contents.as_toctrees(page)
    source[0] = text
