"""Commands that others add to the command line: nothing of theirs is imported before it is asked for."""

from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

import typer
from typer.core import TyperGroup

GROUP: Final = "acrc.commands"
"""The entry points whose packages add a command each: its name, and the `typer.Typer` behind it."""


class WithAdded(TyperGroup):
    """The commands of the testbed, and those that installed packages add."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names, the added ones last."""
        return [*super().list_commands(ctx), *sorted(_added())]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of this name; None if there is none."""
        if own := super().get_command(ctx, cmd_name):
            return own
        entry = _added().get(cmd_name)
        return None if entry is None else typer.main.get_command(entry.load())


def _added() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}
