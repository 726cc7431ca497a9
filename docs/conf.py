"""Sphinx configuration for `acrc docs`."""

import re

from sphinx.application import Sphinx

from actors.installation import version as installed

project = html_title = "ACRC testbed"
release = installed.package_version()
extensions = ["myst_parser", "sphinx.ext.autodoc"]
root_doc = "index"
default_role = "code"
smartquotes = False

html_theme = "furo"
html_show_copyright = html_show_sphinx = html_show_sourcelink = html_copy_source = False

myst_heading_anchors = 4
# Links to folders of the repository; tests/documentation checks all links.
suppress_warnings = ["myst.xref_missing"]

autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True, "undoc-members": True}
python_use_unqualified_type_names = True


def setup(app: Sphinx) -> None:
    """Generate the navigation from the lists of links in index.md."""
    app.connect("source-read", _add_toctrees)


def _add_toctrees(app: Sphinx, name: str, source: list[str]) -> None:
    if name == root_doc:
        listed = set[str]()
        for heading, section in re.findall(r"^## (.+)\n((?:(?!## ).*\n?)*)", source[0], re.MULTILINE):
            pages = [page for page in re.findall(r"\]\(([\w/-]+\.md)\)", section) if page not in listed]
            listed.update(pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n" + "\n".join(pages) + "\n```\n"
