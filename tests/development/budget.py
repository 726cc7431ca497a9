"""Size of the product: tokens without comments and docstrings, and modules, per package.

`python -m tests.development.budget` prints the current size; `--write` also saves it in budget.toml.
"""

import ast
import io
import re
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
FILE: Final = Path(__file__).with_name("budget.toml")
LAYOUT: Final = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
}


def tokens(source: str) -> int:
    """Return the number of tokens of a module, without comments, docstrings and layout."""
    bodies = [getattr(node, "body", None) for node in ast.walk(ast.parse(source))]
    statements = [one for body in bodies if isinstance(body, list) for one in body]
    docstrings = {
        (one.lineno, one.col_offset)
        for one in statements
        if isinstance(one, ast.Expr)
        and isinstance(one.value, ast.Constant)
        and isinstance(one.value.value, str)
    }
    counted = tokenize.generate_tokens(io.StringIO(source).readline)
    return sum(
        one.type not in LAYOUT and not (one.type == tokenize.STRING and one.start in docstrings)
        for one in counted
    )


def class_definitions(source: str) -> Iterator[ast.ClassDef]:
    """Yield all classes of a module; faster than ast.walk, which visits expressions as well."""
    todo: list[ast.AST] = [ast.parse(source)] if re.search(r"^\s*class ", source, re.MULTILINE) else []
    while todo:
        node = todo.pop()
        if isinstance(node, ast.ClassDef):
            yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            todo.extend(getattr(node, part, ()))


def committed(*patterns: str) -> list[Path]:
    """Return relative paths of the files of the clone that git does not ignore."""
    asked = ["git", "ls-files", "--cached", "--others", "--exclude-standard", *patterns]
    listed = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    return [Path(name) for name in listed if (ROOT / name).exists()]


def measure() -> dict[str, dict[str, int]]:
    """Return `tokens` and `modules` by package, of all Python files but the tests."""
    size, modules = Counter[str](), Counter[str]()
    for file in (one for one in committed("*.py") if one.parts[0] != "tests"):
        size[file.parts[0]] += tokens((ROOT / file).read_text("utf-8"))
        modules[file.parts[0]] += 1
    return {"tokens": dict(sorted(size.items())), "modules": dict(sorted(modules.items()))}


def as_toml(tables: dict[str, dict[str, int]]) -> str:
    """Return the text of budget.toml."""
    parts = ["# Upper limits that only go down; see CONTRIBUTING.md."]
    for title, values in tables.items():
        parts.append("\n".join((f"[{title}]", *(f"{name} = {value}" for name, value in values.items()))))
    return "\n\n".join(parts) + "\n"


def main(words: list[str]) -> None:
    """Print the current size and, with `--write`, save it."""
    suite = tomllib.loads(FILE.read_text())["suite"] if FILE.is_file() else {"processes": 3000}
    text = as_toml({**measure(), "suite": suite})
    sys.stdout.write(text)
    if words == ["--write"]:
        FILE.write_text(text)


if __name__ == "__main__":
    main(sys.argv[1:])
