"""Tables as Parquet files, one each."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow
from pyarrow import parquet

from actors.runtime import regular_file
from observation.export.columns import TABLES, ExportTable
from observation.export.robot_rows import Row, Tables

_TYPES: Final = {
    "float": pyarrow.float64(),
    "int": pyarrow.int64(),
    "bool": pyarrow.bool_(),
    "text": pyarrow.string(),
}


def write(rows: Tables, folder: Path) -> list[tuple[Path, int]]:
    """A file for each table, `NAME.parquet`, over what is there: the paths, with how many rows each has.

    Meanings stand in the files, too, as metadata `meaning` of each column. OSError as for any file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, table in arrow(rows).items():
        path = folder / f"{name}.parquet"
        with regular_file.replaced(path) as part:
            parquet.write_table(table, part)
        written.append((path, table.num_rows))
    return written


def arrow(rows: Tables) -> dict[str, pyarrow.Table]:
    """The tables in memory, by name, with the meanings of their columns as metadata."""
    return {table.name: _columns(table, rows[table.name]) for table in TABLES}


def _columns(table: ExportTable, rows: Sequence[Row]) -> Any:
    fields = [
        pyarrow.field(one.name, _TYPES[one.kind], metadata={"meaning": one.meaning}) for one in table.columns
    ]
    columns = zip(*rows, strict=True) if rows else ((),) * len(fields)
    arrays = [pyarrow.array(column, field.type) for column, field in zip(columns, fields, strict=True)]
    return pyarrow.table(arrays, schema=pyarrow.schema(fields, metadata={"row": table.row}))
