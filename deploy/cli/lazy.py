"""Groups of commands from packages above this one, found by name: nothing imports them before it is asked."""

from importlib import import_module
from typing import Any, Final

import typer
from typer.core import TyperGroup

GROUPS: Final = {"bench": "benchmarks.cli.app"}
"""The module behind each group; its `app` is a `typer.Typer`."""


class WithLazyGroups(TyperGroup):
    """The commands of this package, and those of `GROUPS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names, those of groups from elsewhere last."""
        return [*super().list_commands(ctx), *GROUPS]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of this name; None if there is none."""
        if cmd_name in GROUPS:
            return typer.main.get_command(import_module(GROUPS[cmd_name]).app)
        return super().get_command(ctx, cmd_name)
