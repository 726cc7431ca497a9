"""Tables of items of a task that is not cleaning, from a declaration that may be hostile."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from acrc_testbed.export.parquet_files import arrow_tables, tables_of
from acrc_testbed.export.table_rows import RunTables, items_name
from acrc_testbed.run_model.data import ItemEvent, Route, RunData, RunDataError
from acrc_testbed.run_model.model import RunModel
from acrc_testbed.run_model.task_state import FirstEvents, ItemTable
from actors.items import ItemGivenUp, ItemKey
from actors.messages import DRIVE, TASK_CHANGED, Drive, ItemMark, RobotTruth, TaskChanged, TaskEvent, Truth
from actors.task.task import Column, MarkStyle, Metric, TaskDeclaration
from tests.run_data import run_data

TASK = TaskDeclaration(
    name="delivery",
    table="orders",
    item="order",
    items="orders",
    done="delivered",
    metrics=(Metric("delivered", "orders delivered", "orders", "delivered", rank=1),),
    marks={"waiting": MarkStyle("square", "order", True), "delivered": MarkStyle("disc", "delivered order")},
    columns=(
        Column("order", "integer", "number"),
        Column("late_s", "number", "s after the deadline", "late"),
        Column("by", "text", "robot"),
        Column("is_late", "boolean", "after the deadline"),
    ),
)


def table(rows: list[Mapping[str, Any]], task: TaskDeclaration = TASK) -> list[dict[str, Any]]:
    columns = [column.name for column in task.columns]
    name = items_name(task)
    found = arrow_tables(RunTables(task, {name: [tuple(map(row.get, columns)) for row in rows]}))
    listed: list[dict[str, Any]] = found[name].to_pylist()
    return listed


def test_the_table_has_the_declared_name_columns_and_types() -> None:
    assert table([{"order": 1, "late_s": 2, "by": "r1", "is_late": True}, {"order": 2}]) == [
        {"order": 1, "late": 2.0, "by": "r1", "is_late": True},
        {"order": 2, "late": None, "by": None, "is_late": None},
    ]
    (schema,) = (one for one in tables_of(TASK) if one.name == "orders")
    assert [column.kind for column in schema.columns] == ["int", "float", "text", "bool"]


@pytest.mark.parametrize(
    "row", [{"order": "one"}, {"order": 1 << 80}, {"late_s": "never"}, {"by": 1}, {"is_late": "yes"}], ids=str
)
def test_values_of_another_type_are_refused(row: Mapping[str, Any]) -> None:
    with pytest.raises(RunDataError, match=r"table orders: .* is not of type"):
        table([row])


@pytest.mark.parametrize("name", ["../orders", "poses", "Orders", "", "o" * 50])
def test_a_name_that_is_no_name_of_a_file_is_replaced(name: str) -> None:
    assert items_name(msgspec.structs.replace(TASK, table=name)) == "items"


def model(**task: Any) -> RunModel:
    description = run_data(("r1", "r2"), 100_000, true=np.zeros((0, 2, 3))).description
    declared = msgspec.structs.replace(TASK, **task)
    return RunModel(replace(description, task=declared, item_counts={"r1": 1, "r2": 0}))


def truth(step: int) -> Truth:
    state = (0.0,) * 6
    robots = tuple(RobotTruth(robot, *state, True, True, 0) for robot in ("r1", "r2"))
    return Truth(step, step * 100_000, robots)


def extended(of: RunModel, steps: range, *changes: TaskChanged, drive: Drive | None = None) -> RunData:
    for step in steps:
        of.extend("swarm/infra/truth", truth(step))
    for change in changes:
        of.extend(TASK_CHANGED.key(), change)
    if drive is not None:
        of.extend(DRIVE.key("r2"), drive)
    return of.advance(steps[-1])


def test_marks_and_routes_give_states_part_by_part() -> None:
    here, table = model(), ItemTable()
    waiting, done = (
        ItemMark("desk", 0, 1.0, 2.0, "waiting"),
        ItemMark("desk", 0, 1.0, 2.0, "delivered", "r2"),
    )
    event, unknown = TaskEvent("r2", 150_000, "delivered", "desk", 0), TaskEvent("r9", 0, "delivered")
    key, own = ItemKey("desk", 0), ItemKey("r1", 0)
    gives_up = ItemGivenUp("r1", 0, 120_000, "it is heavy")
    drive = Drive(1, 0.0, 0.0, 0.0, 0, given_up=(gives_up,), route=(key, own))
    first = extended(
        here,
        range(2),
        TaskChanged(0, (waiting, ItemMark("r1", 0, 3.0, 3.0, "waiting"))),
        TaskChanged(2, (done,), (event, event, unknown)),
        drive=drive,
    )
    assert first.items_left.tolist() == [[1, 0], [1, 2]] and first.task_events == ()
    assert first.taken_over == (ItemEvent("r2", 0.1, own),), "a desk is no robot"
    assert first.given_up == (ItemEvent("r2", 0.12, own),)
    assert first.routes == (Route("r2", 0.1, (key, own)),)
    start, moved = table.extend(first)
    assert {one: state.holders for one, state in start.states.items()} == {key: (), own: ("r1",)}
    assert {one: state.holders for one, state in moved.states.items()} == {key: ("r2",), own: ("r1", "r2")}
    gone = ItemMark("r1", 0, 3.0, 3.0, "")
    second = extended(here, range(2, 4), TaskChanged(3, (gone,)))
    assert FirstEvents().take(second.task_events) == [event]
    assert [(one.second, *one.states) for one in table.extend(second)] == [(0.2, key), (0.3, own)]
    assert table.states[key].state == "delivered" and table.states[key].by == "r2" and own not in table.states


def test_robots_that_list_no_items_always_have_work() -> None:
    here = model(lists_items=False)
    run = extended(here, range(2), TaskChanged(0, (ItemMark("r1", 0, 3.0, 3.0, "waiting"),)))
    assert run.items_left.tolist() == [[1, 1]] * 2
    assert [one.states[ItemKey("r1", 0)].holders for one in ItemTable().extend(run)] == [()]
