"""The table of contents of the site: it is the lists of links in docs/index.md, heading by heading."""

from command_line.documentation.markdown import MarkdownPage


def chapters(home: MarkdownPage) -> dict[str, list[str]]:
    """The pages below each heading of the home page, each once, as it names them and in its order."""
    found: dict[str, list[str]] = {}
    named: set[str] = set()
    for link in home.links():
        if link.is_local and link.heading and link.target.endswith(".md") and link.target not in named:
            named.add(link.target)
            found.setdefault(link.heading, []).append(link.target)
    return found


def as_toctrees(home: MarkdownPage) -> str:
    """The same as hidden `toctree` directives in Markdown, which make the site's navigation."""
    return "\n".join(
        f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n" + "\n".join(names) + "\n```\n"
        for heading, names in chapters(home).items()
    )
