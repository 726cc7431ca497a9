"""A finished run whose files are damaged one at a time: whether the seal names the one."""

import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

from actors.installation.repository import SHIPPED
from actors.runtime.errors import AcrcError
from benchmarks.statistics.measured import Measured, table_of
from benchmarks.statistics.runs import in_memory
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.replay import record_check
from observation.results.seal import SUMS

_SCENARIO: Final = SHIPPED / "scenarios" / "head_on.toml"
_SECONDS: Final = 2.0


def check(runs: int = 200, seed: int = 1) -> Measured:
    """Damage so many copies, in ways and files drawn from the seed; it holds where each file is named."""
    draw, rows = random.Random(seed), []
    with in_memory(load_scenario(_SCENARIO, Overrides(duration=_SECONDS))) as (plan, _):
        whole = plan.out
        record_check.check(whole)
        files = sorted(path.relative_to(whole) for path in whole.rglob("*") if _is_sealed(path))
        for number in range(runs):
            copy, name = whole.with_name(str(number)), draw.choice(files)
            shutil.copytree(whole, copy, symlinks=True)
            how = draw.choice(sorted(_DAMAGES))
            _DAMAGES[how](copy / name, draw)
            says = _said(copy)
            rows.append({"file": str(name), "damage": how, "named": name.name in says})
            shutil.rmtree(copy)
    named = sum(bool(row["named"]) for row in rows)
    wrong = [row for row in rows if not row["named"]]
    title = f"{named} of {runs} damaged files named"
    return Measured(rows, (table_of(wrong, title),) if wrong else (title,), not wrong)


def _is_sealed(path: Path) -> bool:
    return path.is_file() and not path.is_symlink() and path.name != SUMS


def _said(out: Path) -> str:
    """What the check says of a run; nothing if all is well."""
    try:
        record_check.check(out)
    except AcrcError as error:
        return str(error)
    return ""


def _flipped(path: Path, draw: random.Random) -> None:
    data = bytearray(path.read_bytes())
    if data:
        data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    else:
        data += b"\0"
    path.write_bytes(data)


def _linked(path: Path, _: random.Random) -> None:
    elsewhere = path.rename(path.with_name(f"{path.name}.moved"))
    path.symlink_to(elsewhere)


_DAMAGES: Final[dict[str, Callable[[Path, random.Random], object]]] = {
    "a bit flipped": _flipped,
    "removed": lambda path, _: path.unlink(),
    "renamed": lambda path, _: path.rename(path.with_name(f"other-{path.name}")),
    "cut off": lambda path, _: path.write_bytes(path.read_bytes()[:-1]),
    "replaced by a link": _linked,
}
