"""Schemas of the exported tables, and their Parquet files."""

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import pyarrow
from pyarrow import parquet

from acrc_testbed.export.table_rows import Row, RunTables, items_name
from acrc_testbed.run_model.data import RunDataError
from actors.runtime import regular_file
from actors.task.task import TaskDeclaration

Kind = Literal["float", "int", "bool", "text"]


class TableColumn(msgspec.Struct, frozen=True, array_like=True):
    """One column of a table."""

    name: str
    kind: Kind
    meaning: str
    """Meaning with the unit, and with the condition for null, if any."""


class ExportTable(msgspec.Struct, frozen=True):
    """Schema of one table, a file of the export."""

    row: str
    columns: tuple[TableColumn, ...]
    name: str = ""


def _any_tables() -> tuple[ExportTable, ...]:
    """Return the tables of any task, which `tables.toml` declares."""
    text = resources.files(__package__).joinpath("tables.toml").read_bytes()
    tables = msgspec.toml.decode(text, type=dict[str, ExportTable])
    return tuple(msgspec.structs.replace(table, name=name) for name, table in tables.items())


TABLES: Final = _any_tables()
_KINDS: Final[dict[str, Kind]] = {"text": "text", "integer": "int", "number": "float", "boolean": "bool"}


def tables_of(task: TaskDeclaration) -> tuple[ExportTable, ...]:
    """Return the schemas of all tables of a run: TABLES, and the task's items."""
    columns = tuple(
        TableColumn(one.exported or one.name, _KINDS.get(one.type, "text"), one.description)
        for one in task.columns
    )
    return *TABLES, ExportTable(f"one {task.item} and its outcome", columns, items_name(task))


def schema_page(task: TaskDeclaration) -> str:
    """Return the schemas of a task's runs as Markdown for the documentation."""
    parts = []
    for table in tables_of(task):
        parts.append(
            f"## {table.name}\n\nA row is {table.row}.\n\n| column | type | meaning |\n|---|---|---|\n"
        )
        parts += [f"| `{one.name}` | {one.kind} | {one.meaning} |\n" for one in table.columns]
        parts.append("\n")
    return "".join(parts).rstrip("\n") + "\n"


_TYPES: Final = {
    "float": pyarrow.float64(),
    "int": pyarrow.int64(),
    "bool": pyarrow.bool_(),
    "text": pyarrow.string(),
}


def write(run: RunTables, folder: Path) -> list[tuple[Path, int]]:
    """Write each table to `NAME.parquet`, and return paths and numbers of rows.

    Existing files are replaced, or removed if the run lacks the table. Each column has its meaning as
    metadata `meaning`. Raises OSError, and RunDataError for a value of another type than the task declares.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in missing_tables(run):
        (folder / f"{name}.parquet").unlink(missing_ok=True)
    written = []
    for name, table in arrow_tables(run).items():
        path = folder / f"{name}.parquet"
        with regular_file.atomic_replacement(path) as part:
            parquet.write_table(table, part)
        written.append((path, table.num_rows))
    return written


def missing_tables(run: RunTables) -> list[str]:
    """Return the names of the missing tables, as for a lean recording."""
    return [table.name for table in tables_of(run.task) if table.name not in run.rows]


def arrow_tables(run: RunTables) -> dict[str, pyarrow.Table]:
    """Return the tables in memory by name, with the meanings of columns as metadata."""
    return {
        table.name: _arrow_table(table, run.rows[table.name])
        for table in tables_of(run.task)
        if table.name in run.rows
    }


def _arrow_table(table: ExportTable, rows: Sequence[Row]) -> Any:
    fields = [
        pyarrow.field(one.name, _TYPES[one.kind], metadata={"meaning": one.meaning}) for one in table.columns
    ]
    columns = zip(*rows, strict=True) if rows else ((),) * len(fields)
    arrays = [_array(table.name, column, field) for column, field in zip(columns, fields, strict=True)]
    return pyarrow.table(arrays, schema=pyarrow.schema(fields, metadata={"row": table.row}))


def _array(table: str, values: Row, field: Any) -> Any:
    try:
        return pyarrow.array(values, field.type)
    except (pyarrow.ArrowException, OverflowError) as error:
        raise RunDataError(f"table {table}: {field.name} is not of type {field.type}: {error}") from None
