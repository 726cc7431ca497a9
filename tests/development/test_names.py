"""A class name means one thing, and a call with many values says which is which."""

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

from actors.installation.repository import PACKAGES, REPOSITORY

MOST_POSITIONAL = 7


@cache
def trees() -> dict[Path, ast.Module]:
    """The product's modules."""
    files = [file for package in (*PACKAGES, "maps") for file in (REPOSITORY / package).rglob("*.py")]
    return {file.relative_to(REPOSITORY): ast.parse(file.read_text()) for file in files}


@cache
def classes() -> dict[str, list[str]]:
    """Where each class is defined, by its name."""
    found = defaultdict[str, list[str]](list)
    for file, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(f"{file}:{node.lineno}")
    return found


def test_no_two_classes_have_one_name() -> None:
    assert not {name: places for name, places in classes().items() if len(places) > 1}


def test_an_object_of_ours_is_not_made_from_many_positional_values() -> None:
    ours, calls = classes(), []
    for file, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ours:
                given = sum(not isinstance(argument, ast.Starred) for argument in node.args)
                if given > MOST_POSITIONAL:
                    calls.append(f"{file}:{node.lineno}: {node.func.id} from {given} values; name them")
    assert not calls, "\n".join(calls)
