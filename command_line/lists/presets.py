"""Which presets there are of the radio, of localisation and of navigation."""

from pathlib import Path
from types import ModuleType

import msgspec

from command_line.lists.rows import constant_doc, print_rows, said_of


class ListedPreset(msgspec.Struct, frozen=True):
    """A preset that a scenario can name."""

    table: str
    """The scenario's table whose `preset` it can be."""
    name: str
    summary: str


def listed() -> tuple[ListedPreset, ...]:
    """All presets, table by table."""
    from actors.radio import presets as radio
    from actors.robot.localisation import parameters
    from actors.robot.navigation import navigator
    from deploy.scenario import stack_tables

    return (
        *_of("radio", radio, "PRESETS"),
        *_of("localisation", parameters, "PRESETS"),
        ListedPreset("localisation", stack_tables.ODOMETRY, _doc(stack_tables, "ODOMETRY").removesuffix(".")),
        *_of("navigation", navigator, "NAVIGATION_PRESETS"),
    )


def print_presets(*, json: bool) -> None:
    """Print them on standard output."""
    rows = listed()
    columns = {
        "table": [f"[{row.table}]" for row in rows],
        "preset": [row.name for row in rows],
        "what it is": [row.summary for row in rows],
    }
    print_rows(rows, columns, json=json)


def _of(table: str, module: ModuleType, constant: str) -> list[ListedPreset]:
    doc = _doc(module, constant)
    return [ListedPreset(table, name, said_of(name, doc)) for name in getattr(module, constant)]


def _doc(module: ModuleType, constant: str) -> str:
    return constant_doc(Path(str(module.__file__)), constant)
