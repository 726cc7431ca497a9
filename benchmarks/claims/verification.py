"""Claims checked one after the other, and the tables of docs/how-true.md, one for each part."""

import difflib
import json
import re
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich.table import Table

from actors.console import screen
from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from benchmarks.claims.claim import PublishedClaim
from benchmarks.claims.table import CLAIMS
from benchmarks.statistics.measured import Measured

CHECKED: Final = {claim.name: claim for claim in CLAIMS if claim.module}
_VERDICTS: Final[Mapping[bool | None, str]] = {True: "holds", False: "DOES NOT HOLD", None: "measured only"}


def chosen(names: Sequence[str]) -> list[PublishedClaim]:
    """The claims of these names; all without names. Raises OptionError for one that there is not."""
    for name in names:
        if name not in CHECKED:
            near = difflib.get_close_matches(name, CHECKED, n=1)
            right = f"did you mean {near[0]}?" if near else f"must be one of {', '.join(CHECKED)}"
            raise OptionError(f"CLAIM: {name}; {right}")
    return [CHECKED[name] for name in dict.fromkeys(names or CHECKED)]


def listed() -> Measured:
    """The claims, and about what checking each takes."""
    table = Table("claim", "says", "small size", "full size", title="acrc verify CLAIM …")
    for claim in CHECKED.values():
        table.add_row(claim.name, claim.says.replace("`", ""), *map(_took, claim.seconds))
    figures = [
        {"name": claim.name, "says": claim.says, "small_s": claim.seconds[0], "full_s": claim.seconds[1]}
        for claim in CHECKED.values()
    ]
    return Measured(figures, (table,))


def verified_alone(claim: PublishedClaim, given: Mapping[str, Any], *, full: bool) -> Measured:
    """One claim, with all that was found, and the verdict below it."""
    found = claim.check(claim.settings(given, full=full))
    verdict = () if found.holds is None else (f"{claim.name}: {_VERDICTS[found.holds]}",)
    return Measured(found.figures, (*found.shown, *verdict), found.holds)


def verified(claims: Sequence[PublishedClaim], given: Mapping[str, Any], *, full: bool) -> Measured:
    """Several claims: a row for each, and below what was found of those that do not hold."""
    say = screen(stderr=True)
    table = Table("claim", "", "s", title=f"claims in {'full' if full else 'small'} size")
    figures: dict[str, Any] = {}
    details: list[Table | str] = []
    for claim in claims:
        say.print(f"{claim.name}, about {_took(claim.seconds[full])} …")
        began = time.monotonic()
        try:
            own = {name: value for name, value in given.items() if name in claim.takes}
            found = claim.check(claim.settings(own, full=full))
        except AcrcError as error:
            found = Measured({"error": str(error)}, (f"{claim.name}: {error}",), False)
        took = time.monotonic() - began
        figures[claim.name] = {"holds": found.holds, "s": round(took, 1), "found": found.figures}
        table.add_row(claim.name, _VERDICTS[found.holds], f"{took:.0f}")
        details += [] if found.holds is not False else found.shown
    return Measured(figures, (table, *details), not any(one["holds"] is False for one in figures.values()))


def _took(seconds: int) -> str:
    return f"{seconds} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def told(found: Measured, *, json_output: bool) -> int:
    """Print it; the exit code: 1 if what was claimed does not hold."""
    if json_output:
        sys.stdout.write(json.dumps(found.figures) + "\n")
    else:
        found.show()
    return 1 if found.holds is False else 0


PAGE: Final = REPOSITORY / "docs" / "how-true.md"
_TABLE: Final = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


def table(part: str) -> str:
    """A row for each claim of that part."""
    rows = [_row(claim) for claim in CLAIMS if claim.part == part]
    return "\n".join(["| claim | what came out | command |", "|---|---|---|", *rows]) + "\n"


def _row(claim: PublishedClaim) -> str:
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
