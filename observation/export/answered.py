"""What the program says that executes one robot for an export: rows, of which nothing is believed.

Whoever's code ran wrote them. They are counted in bytes, and each cell is held to its column's type.
"""

from typing import Any, Final

import msgspec

from actors.runtime.errors import AcrcError, printable
from observation.export.columns import TABLES, Column
from observation.export.robot_rows import EXECUTED, Tables
from observation.replay.shut_off_calls import Bounds, CallOutcome

FILE_MB: Final = 256
"""Of an answer; ten minutes of a robot among twenty have one."""
BOUNDS: Final = Bounds(FILE_MB * 1_000_000)
_WHOLE: Final = 2**63
_ADDED: Final = ("robot", "process")
"""Columns that whoever asked fills in."""
_AS_ADDRESS: Final = Column("via", "int", "the address instead of the robot")
_KINDS: Final[dict[str, type | tuple[type, ...]]] = {
    "float": (float, int),
    "int": int,
    "bool": bool,
    "text": str,
}


class ExportError(AcrcError):
    """A robot whose rows are not to be had."""


class RowsAnswer(msgspec.Struct, frozen=True):
    """What came of one robot: one of the two."""

    tables: dict[str, list[tuple[Any, ...]]] = {}
    fault: str | None = None


def words() -> tuple[str, ...]:
    """What the program is told beside the robot."""
    return ("--file-mb", str(FILE_MB))


def encode(answer: RowsAnswer) -> bytes:
    """For the way out of the program that is shut off."""
    return msgspec.msgpack.encode(answer, enc_hook=float)


def read_answer(answer: CallOutcome) -> Tables:
    """The rows by table, as `robot_rows` gives them. Raises ExportError for a fault, and for all else."""
    if answer.data is None:
        raise ExportError(answer.fault or f"{answer.name}: nothing was answered")
    try:
        found = msgspec.msgpack.decode(answer.data, type=RowsAnswer)
    except (ValueError, RecursionError) as error:
        raise ExportError(f"{answer.name}: what it answers makes no sense: {printable(str(error))}") from None
    if found.fault is not None:
        raise ExportError(found.fault)
    if wrong := _misfit(found.tables):
        raise ExportError(f"{answer.name}: what it answers makes no sense: {wrong}")
    return found.tables


def _misfit(tables: Tables) -> str:
    """Which cell is not what its column says; empty if all are."""
    if set(tables) != set(EXECUTED):
        return f"it has the tables {', '.join(map(ascii, sorted(tables)))[:200]}"
    for table in TABLES:
        columns = [_raw(one) for one in table.columns if one.name not in _ADDED]
        for number, row in enumerate(tables.get(table.name, ())):
            if len(row) != len(columns):
                return f"row {number} of {table.name} has {len(row)} cells, and must have {len(columns)}"
            for place, (cell, column) in enumerate(zip(row, columns, strict=True)):
                if not _fits(cell, column, needed=place < 2):
                    shown = ascii(cell)[:80]
                    return f"{column.name} is {shown} in row {number} of {table.name}; must be {column.kind}"
    return ""


def _raw(column: Column) -> Column:
    return _AS_ADDRESS if column.name == _AS_ADDRESS.name else column


def _fits(cell: object, column: Column, *, needed: bool) -> bool:
    if cell is None:
        return not needed
    kind = _KINDS[column.kind]
    if not isinstance(cell, kind) or (isinstance(cell, bool) and column.kind != "bool"):
        return False
    return not isinstance(cell, int) or -_WHOLE <= cell < _WHOLE
