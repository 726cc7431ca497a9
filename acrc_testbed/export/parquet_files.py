"""Schemas of the exported tables, and their Parquet files."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import pyarrow
from pyarrow import parquet

from acrc_testbed.export.table_rows import Row, RunTables, items_name
from acrc_testbed.run_model.data import RunDataError
from actors.runtime import regular_file
from actors.task.task import TaskDeclaration

Kind = Literal["float", "int", "bool", "text"]


@dataclass(frozen=True)
class TableColumn:
    """One column of a table."""

    name: str
    kind: Kind
    meaning: str
    """Meaning with the unit, and with the condition for null, if any."""


@dataclass(frozen=True)
class ExportTable:
    """Schema of one table, a file of the export."""

    name: str
    row: str
    columns: tuple[TableColumn, ...]


_STEP: Final = TableColumn("step", "int", "number of the step, from 0")
_SECONDS: Final = TableColumn("seconds", "float", "simulated time, s")
_ROBOT: Final = TableColumn("robot", "text", "id of the robot")
_PROCESS: Final = TableColumn("process", "text", "its process: `r2`, after the first restart `r2.1`")


def _pose(kind: str) -> tuple[TableColumn, ...]:
    return (
        TableColumn("x", "float", f"{kind} x, m, map frame"),
        TableColumn("y", "float", f"{kind} y, m, map frame"),
        TableColumn("heading", "float", f"{kind} heading, rad, counter-clockwise from x"),
    )


TABLES: Final = (
    ExportTable(
        "poses",
        "the ground truth of one robot at the start of one step",
        (
            _STEP, _SECONDS, _ROBOT, *_pose("true"),
            TableColumn("vx", "float", "true velocity in x, m/s, map frame"),
            TableColumn("vy", "float", "true velocity in y, m/s, map frame"),
            TableColumn("omega", "float", "true turn rate, rad/s"),
            TableColumn("stepping", "bool", "false: its process is frozen or has exited"),
            TableColumn("powered", "bool", "false: its transceiver is off"),
            TableColumn("charge", "float", "share of the battery's capacity left; null: not simulated"),
        ),
    ),
    ExportTable(
        "people",
        "the ground truth of one person at the start of one step; no rows without people",
        (
            _STEP, _SECONDS,
            TableColumn("person", "int", "number of the person, from 1"),
            TableColumn("x", "float", "true x, m, map frame"),
            TableColumn("y", "float", "true y, m, map frame"),
            TableColumn("vx", "float", "true velocity in x, m/s, map frame"),
            TableColumn("vy", "float", "true velocity in y, m/s, map frame"),
        ),
    ),
    ExportTable(
        "estimates",
        "the pose estimate of one robot at the start of one step that it executed",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS, *_pose("estimated"),
            TableColumn("located", "bool", "false: it stands until localised after a start"),
            TableColumn("var_x", "float", "estimated variance of x, m²"),
            TableColumn("var_y", "float", "estimated variance of y, m²"),
            TableColumn("var_heading", "float", "estimated variance of the heading, rad²"),
            TableColumn("lost", "float", "estimated probability of being lost"),
            TableColumn("error", "float", "localisation error: distance to the true position, m"),
        ),
    ),
    ExportTable(
        "goals",
        "a new goal of navigation, or a change of its status or phase",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            TableColumn("x", "float", "x of the goal, m, map frame; null: the goal was removed"),
            TableColumn("y", "float", "y of the goal, m, map frame; null: the goal was removed"),
            TableColumn("status", "text", "`active`, `succeeded` or `aborted`; null without a goal"),
            TableColumn("reason", "text", "reason of the abort; null otherwise"),
            TableColumn("phase", "text", "phase of navigation while the goal is active; null otherwise"),
        ),
    ),
    ExportTable(
        "frames",
        "a frame at one other robot, or a frame that was not sent",
        (
            TableColumn("frame", "int", "number of the frame, from 0, by its end"),
            TableColumn("sender", "text", "id of the sending robot"),
            TableColumn("tag", "int", "the sender's number of the frame"),
            TableColumn("handed", "float", "when the transceiver was given the frame, simulated s"),
            TableColumn("seconds", "float", "when the frame ended or was dropped, simulated s"),
            TableColumn("size", "int", "payload, bytes; MAC header and checksum add 9"),
            TableColumn("fate", "text", "`sent`, `access_failure` or `overflow`"),
            TableColumn("receiver", "text", "another robot whose transceiver was on; null: not sent"),
            TableColumn("copy", "text", "`heard`, or the reason of the loss at the receiver; null: not sent"),
            TableColumn("strength", "float", "received strength, dBm; -inf: too weak to track; null: not sent"),
        ),
    ),
    ExportTable(
        "knowledge",
        "a field of a component's knowledge that changed",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            TableColumn("component", "text", "id of the component"),
            TableColumn("change", "int", "number of the change within `process`, from 0; one for all its fields"),
            TableColumn(
                "by", "text",
                "component process, such as `CleaningRobot.sense`, "
                "or exchange, such as `DestinationAdoption.at_member`",
            ),
            TableColumn("adaptation", "bool", "true for an ensemble, and for a process of the adaptation layer"),
            TableColumn("field", "text", "such as `destination.owner`; in a mapping, `bids[r2]`"),
            TableColumn("before", "text", "previous value, JSON"),
            TableColumn("after", "text", "new value, JSON"),
        ),
    ),
    ExportTable(
        "exchanges",
        "an exchange of an ensemble that changed a component's knowledge",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            TableColumn("component", "text", "id of the changed component"),
            TableColumn("change", "int", "as in `knowledge`, which lists the fields"),
            TableColumn("ensemble", "text", "the exchange, as in `by` of `knowledge`"),
            TableColumn("peer", "text", "id of the component whose replica was used"),
            TableColumn("epoch", "int", "restarts of the peer's node; null: the peer is on the same node"),
            TableColumn("publication", "int", "number of the publication in that epoch; null as for `epoch`"),
            TableColumn("heard", "float", "when it was received, simulated s; null as for `epoch`"),
            TableColumn("age", "float", "age of the replica when used, s; null as for `epoch`"),
            TableColumn("hops", "int", "number of relays; null as for `epoch`"),
            TableColumn("rssi", "float", "received strength of its last frame, dBm; null as for `epoch`"),
            TableColumn("via", "text", "robot that sent this frame; null as for `epoch`"),
        ),
    ),
    ExportTable(
        "decisions",
        "a decision of a robot's adaptation",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            TableColumn("change", "int", "as in `knowledge`"),
            TableColumn("by", "text", "component process or exchange that decided"),
            TableColumn("words", "text", "description of the decision"),
            TableColumn("source", "text", "id of the component whose knowledge it used"),
            TableColumn("old_x", "float", "x of the previous goal, m, map frame; null: none"),
            TableColumn("old_y", "float", "y of the previous goal, m, map frame; null: none"),
            TableColumn("new_x", "float", "x of the new goal, m, map frame; null: none"),
            TableColumn("new_y", "float", "y of the new goal, m, map frame; null: none"),
        ),
    ),
    ExportTable(
        "outcomes",
        "a value returned by the `outcome()` of one robot's behaviour; none for a run that was cut off",
        (
            _ROBOT,
            TableColumn("name", "text", "name of the value, such as `waited_s`; in a dict, `tokens.taken`"),
            TableColumn("number", "float", "the value, true as 1; null: a text"),
            TableColumn("text", "text", "the value; null: a number or boolean"),
        ),
    ),
)  # fmt: skip


"""Tables of any task."""
_KINDS: Final[dict[str, Kind]] = {"text": "text", "integer": "int", "number": "float", "boolean": "bool"}


def tables_of(task: TaskDeclaration) -> tuple[ExportTable, ...]:
    """Return the schemas of all tables of a run: TABLES, and the task's items."""
    columns = tuple(
        TableColumn(one.exported or one.name, _KINDS.get(one.type, "text"), one.description)
        for one in task.columns
    )
    return *TABLES, ExportTable(items_name(task), f"one {task.item} and its outcome", columns)


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
