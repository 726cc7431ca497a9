"""Each row of docs/how-true.md names tests of its claim, and each claim of the suite has a row."""

import ast
import re
from collections.abc import Iterator

from actors.installation.repository import REPOSITORY

ROW = re.compile(r"^\|(?P<cells>.*)\| `acrc verify (?P<claim>[\w-]+)` \|$", re.MULTILINE)


def claims(source: str) -> Iterator[tuple[str, str]]:
    """Yield test function and claim for each marker; a marker of the module applies to all its tests."""
    body = ast.parse(source).body
    of_all = {claim for node in body if isinstance(node, ast.Assign) for claim in claims_in(node.value)}
    for node in body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            own = {claim for decorator in node.decorator_list for claim in claims_in(decorator)}
            yield from ((node.name, claim) for claim in of_all | own)


def claims_in(node: ast.AST) -> set[str]:
    calls = [one for one in ast.walk(node) if isinstance(one, ast.Call)]
    marks = [one for one in calls if isinstance(one.func, ast.Attribute) and one.func.attr == "claim"]
    return {str(one.args[0].value) for one in marks if isinstance(one.args[0], ast.Constant)}


def test_rows_name_tests_of_their_claim_and_claims_have_rows() -> None:
    found = {
        (entry, claim)
        for path in (REPOSITORY / "tests").rglob("test_*.py")
        for name, claim in claims(path.read_text("utf-8"))
        for file in (str(path.relative_to(REPOSITORY)),)
        for entry in (file, f"{file}::{name}")
    }
    page = (REPOSITORY / "docs" / "how-true.md").read_text("utf-8")
    rows = {row["claim"]: re.findall(r"`(tests/[^`]+)`", row["cells"]) for row in ROW.finditer(page)}
    assert all(rows.values())
    missing = {(test, claim) for claim, tests in rows.items() for test in tests} - found
    assert not missing
    assert {claim for _, claim in found} == set(rows)
