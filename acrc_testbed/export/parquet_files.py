"""Tables of an export: their columns with types and meanings, and their Parquet files."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import pyarrow
from pyarrow import parquet

from acrc_testbed.export.rows import Row, Tables
from actors.runtime import regular_file

Kind = Literal["float", "int", "bool", "text"]


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    kind: Kind
    meaning: str
    """With the unit; may be null only where it says when."""


@dataclass(frozen=True)
class ExportTable:
    """One table: a file of the export."""

    name: str
    row: str
    """What a row is."""
    columns: tuple[Column, ...]


_STEP: Final = Column("step", "int", "the step")
_SECONDS: Final = Column("seconds", "float", "simulated time, s")
_ROBOT: Final = Column("robot", "text", "the robot's id")
_PROCESS: Final = Column(
    "process", "text", "its process: the id, or `r2.1` for the first one after a restart"
)


def _pose(whose: str) -> tuple[Column, ...]:
    return (
        Column("x", "float", f"{whose}, m, map frame"),
        Column("y", "float", "the same"),
        Column("heading", "float", "the same, rad, counter-clockwise from x"),
    )


TABLES: Final = (
    ExportTable(
        "poses",
        "ground truth of one robot at the beginning of one step",
        (
            _STEP, _SECONDS, _ROBOT, *_pose("its true pose"),
            Column("vx", "float", "its velocity, m/s, map frame"),
            Column("vy", "float", "the same"),
            Column("omega", "float", "its rate of turning, rad/s"),
            Column("stepping", "bool", "false while it is frozen, or its process has ended"),
            Column("powered", "bool", "false while its transceiver is off"),
        ),
    ),
    ExportTable(
        "estimates",
        "the estimated pose of one robot at the beginning of one step that it took",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS, *_pose("its estimated pose"),
            Column("located", "bool", "false while it was in doubt after a start, and stood"),
            Column("var_x", "float", "its variance of x, m²"),
            Column("var_y", "float", "the same of y, m²"),
            Column("var_heading", "float", "the same of the heading, rad²"),
            Column("lost", "float", "its probability of being lost"),
            Column("error", "float", "localisation error: distance to the true position, m"),
        ),
    ),
    ExportTable(
        "goals",
        "a goal of navigation that was given, or whose status or phase changed",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            Column("x", "float", "the goal, m, map frame; null: from then on there is none"),
            Column("y", "float", "the same"),
            Column("status", "text", "`active`, `succeeded` or `aborted`; null without a goal"),
            Column("reason", "text", "why it was aborted; null otherwise"),
            Column("phase", "text", "what navigation does while the goal is active; null otherwise"),
        ),
    ),
    ExportTable(
        "frames",
        "a frame at one other robot, or a frame that never left its transceiver",
        (
            Column("frame", "int", "counts frames in the order in which they ended, from 0"),
            Column("sender", "text", "the robot that sent it, or was to"),
            Column("tag", "int", "the sender's own number of it"),
            Column("handed", "float", "when the sender's transceiver was handed it, simulated s"),
            Column("seconds", "float", "when it had left the antenna or was dropped, simulated s"),
            Column("size", "int", "bytes of its data; MAC header and check sum are 9 more"),
            Column("fate", "text", "`sent`, `access_failure` or `overflow`"),
            Column("receiver", "text", "another robot whose transceiver was on; null of one not sent"),
            Column("copy", "text", "`heard`, or why it was not heard there; null of one not sent"),
            Column("strength", "float", "its strength there, dBm; -inf: too weak to count; null: not sent"),
        ),
    ),
    ExportTable(
        "knowledge",
        "a field of a component's knowledge that has another value",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            Column("component", "text", "the component's id"),
            Column("change", "int", "the same for all fields that changed at once; counts from 0 by process"),
            Column(
                "by", "text",
                "the process, such as `CleaningRobot.sense`, "
                "or exchange, such as `DestinationAdoption.at_member`",
            ),
            Column("adaptation", "bool", "true of an ensemble, and of a process of the adaptation layer"),
            Column("field", "text", "such as `destination.owner`; of a mapping, `bids[r2]`"),
            Column("before", "text", "the value before, as JSON"),
            Column("after", "text", "the value from then on, as JSON"),
        ),
    ),
    ExportTable(
        "exchanges",
        "an exchange of an ensemble through which a component learned something",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            Column("component", "text", "the id of the component that learned"),
            Column("change", "int", "as in `knowledge`, where the fields stand"),
            Column("ensemble", "text", "the exchange, as in `by` of `knowledge`"),
            Column("peer", "text", "the component of which it learned"),
            Column("epoch", "int", "restarts of the peer's node before; null: it is on the same node"),
            Column("publication", "int", "number of the peer's publication in that epoch; null as before"),
            Column("heard", "float", "when that had come here, simulated s; null as before"),
            Column("age", "float", "how old it was when it was used, s; null as before"),
            Column("hops", "int", "how often it had been relayed; null as before"),
            Column("rssi", "float", "strength of the frame that brought it, dBm; null as before"),
            Column("via", "text", "the robot whose transceiver sent that frame; null as before"),
        ),
    ),
    ExportTable(
        "places",
        "a place to be cleaned, and what became of it",
        (
            Column("owner", "text", "the robot to which it was given"),
            Column("place", "int", "its number in the owner's list, from 0"),
            Column("x", "float", "where it is, m, map frame"),
            Column("y", "float", "the same"),
            Column("given", "float", "when it was given to its owner, simulated s; 0: at the start"),
            Column("verdict", "text", "what became of it in one word; null of a run that was cut off"),
            Column("reached", "float", "when a robot first was there in truth, simulated s; null: never"),
            Column("reached_by", "text", "robot, or null"),
            Column("reported", "float", "when a robot first said so, simulated s; null: never"),
            Column("reported_by", "text", "robot, or null"),
            Column("given_up", "float", "when a robot first gave it up, simulated s; null: never"),
            Column("given_up_by", "text", "robot, or null"),
            Column("reason", "text", "why, in that robot's words; null: it was not given up"),
        ),
    ),
    ExportTable(
        "decisions",
        "something that the adaptation of a robot decided",
        (
            _STEP, _SECONDS, _ROBOT, _PROCESS,
            Column("change", "int", "as in `knowledge`"),
            Column("by", "text", "the process or exchange that decided"),
            Column("words", "text", "what, in words"),
            Column("source", "text", "the component whose knowledge it used"),
            Column("old_x", "float", "where it wanted to be before, m, map frame; null: nowhere"),
            Column("old_y", "float", "the same"),
            Column("new_x", "float", "where it wants to be from then on, m; null: nowhere"),
            Column("new_y", "float", "the same"),
        ),
    ),
)  # fmt: skip


def page() -> str:
    """The tables for the documentation, as Markdown."""
    parts = []
    for table in TABLES:
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


def write(rows: Tables, folder: Path) -> list[tuple[Path, int]]:
    """Write a file for each table, `NAME.parquet`, and return their paths and numbers of rows.

    Files of other runs are replaced, or removed where this run lacks the table. Each column has its meaning
    as metadata `meaning`. OSError as for any file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in lacking(rows):
        (folder / f"{name}.parquet").unlink(missing_ok=True)
    written = []
    for name, table in arrow(rows).items():
        path = folder / f"{name}.parquet"
        with regular_file.replaced(path) as part:
            parquet.write_table(table, part)
        written.append((path, table.num_rows))
    return written


def lacking(rows: Tables) -> list[str]:
    """Return the names of the tables that a lean recording lacks."""
    return [table.name for table in TABLES if table.name not in rows]


def arrow(rows: Tables) -> dict[str, pyarrow.Table]:
    """The tables in memory, by name, with the meanings of their columns as metadata."""
    return {table.name: _columns(table, rows[table.name]) for table in TABLES if table.name in rows}


def _columns(table: ExportTable, rows: Sequence[Row]) -> Any:
    fields = [
        pyarrow.field(one.name, _TYPES[one.kind], metadata={"meaning": one.meaning}) for one in table.columns
    ]
    columns = zip(*rows, strict=True) if rows else ((),) * len(fields)
    arrays = [pyarrow.array(column, field.type) for column, field in zip(columns, fields, strict=True)]
    return pyarrow.table(arrays, schema=pyarrow.schema(fields, metadata={"row": table.row}))
