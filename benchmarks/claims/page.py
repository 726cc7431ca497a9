"""The tables of docs/how-true.md, one for each part; `python -m benchmarks.claims.page` puts them there."""

import re
from typing import Final

from actors.installation.repository import REPOSITORY
from benchmarks.claims.claim import Claim
from benchmarks.claims.table import CLAIMS

PAGE: Final = REPOSITORY / "docs" / "how-true.md"
_TABLE: Final = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


def table(part: str) -> str:
    """A row for each claim of that part."""
    rows = [_row(claim) for claim in CLAIMS if claim.part == part]
    return "\n".join(["| claim | what came out | command |", "|---|---|---|", *rows]) + "\n"


def _row(claim: Claim) -> str:
    command = claim.command or f"acrc verify {claim.name}"
    return f"| {claim.says} | {claim.result} | `{command}` |"


def filled(text: str) -> str:
    """The page with the first table of each part made anew."""
    for part in dict.fromkeys(claim.part for claim in CLAIMS):
        before, heading, after = text.partition(f"\n## {part}\n")
        here, next_heading, rest = after.partition("\n## ")
        old = _TABLE.search(here)
        here = here.replace(old[0], table(part)) if old else f"{here.rstrip()}\n\n{table(part)}"
        text = before + heading + here + next_heading + rest
    return text


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text()))
