"""Words of docstrings, messages and pages; nouns of class names."""

import re

from actors.installation.repository import REPOSITORY
from tests.development.budget import class_definitions, committed
from tests.development.language import findings


def test_no_banned_words() -> None:
    assert list(findings()) == []


def noun(name: str) -> str:
    """Return the last word of a class name, in lower case."""
    words: list[str] = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z][a-z0-9]*|[A-Z]+|[a-z0-9]+", name)
    return words[-1].lower()


def singulars(word: str) -> set[str]:
    """Return a word and its possible singular forms."""
    return {word, word.removesuffix("s"), word.removesuffix("es"), re.sub("ies$", "y", word)}


def test_class_names_end_in_nouns_of_the_glossary() -> None:
    page = (REPOSITORY / "docs" / "concepts.md").read_text("utf-8").partition("## Nouns in class names")[2]
    rows = re.findall(r"^\| ([^|]+) \|[^|]+\|$", page, re.MULTILINE)[1:]
    nouns = [word for row in rows for word in row.split(", ")]
    classes = {
        node.name: path
        for path in committed("*.py")
        if path.parts[0] != "tests"
        for node in class_definitions((REPOSITORY / path).read_text("utf-8"))
    }
    unknown = sorted(
        f"{path}: {name}" for name, path in classes.items() if not singulars(noun(name)) & {*nouns}
    )
    used = {form for name in classes for form in singulars(noun(name))}
    assert unknown == [], "end the name in a noun of docs/concepts.md, or define its noun there"
    assert sorted(word for word in nouns if word not in used or nouns.count(word) > 1) == []
