"""Which presets there are of the radio, of localisation and of navigation.

They are read from the sources where they are defined: importing those takes as long as starting a simulation.
"""

from pathlib import Path
from typing import Final

import msgspec

import actors
import deploy
from command_line.lists.rows import constant_doc, constant_keys, print_rows, said_of

_ACTORS: Final = Path(str(actors.__file__)).parent
_TABLES: Final = Path(str(deploy.__file__)).parent / "scenario" / "stack_tables.py"


class ListedPreset(msgspec.Struct, frozen=True):
    """A preset that a scenario can name."""

    table: str
    """The scenario's table whose `preset` it can be."""
    name: str
    summary: str


def listed() -> tuple[ListedPreset, ...]:
    """All presets, table by table."""
    return (
        *_of("radio", _ACTORS / "radio" / "presets.py", "PRESETS"),
        *_of("localisation", _ACTORS / "robot" / "localisation" / "parameters.py", "PRESETS"),
        ListedPreset("localisation", "odometry", constant_doc(_TABLES, "ODOMETRY").removesuffix(".")),
        *_of("navigation", _ACTORS / "robot" / "navigation" / "navigator.py", "NAVIGATION_PRESETS"),
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


def _of(table: str, source: Path, constant: str) -> list[ListedPreset]:
    doc = constant_doc(source, constant)
    return [ListedPreset(table, name, said_of(name, doc)) for name in constant_keys(source, constant)]
