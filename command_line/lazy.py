"""Commands of the rooms of this package, found by name: nothing imports them before they are asked for."""

from importlib import import_module
from typing import Any, Final

import typer
from typer.core import TyperGroup

COMMANDS: Final = {
    "cluster": ("command_line.cluster", "app"),
    "campaign": ("command_line.experiments.app", "campaign"),
    "causes": ("command_line.experiments.app", "causes"),
    "compare": ("command_line.experiments.app", "compare"),
    "bundle": ("command_line.experiments.app", "bundle"),
    "report": ("command_line.experiments.app", "report"),
    "study": ("command_line.experiments.app", "study_app"),
    "docs": ("command_line.documentation", "docs"),
    "verify": ("command_line.bench.verify", "verify"),
    "bench": ("command_line.bench.bench", "bench"),
}
"""The module behind each, and what it has there: a function, or a `typer.Typer` for a group."""


class WithLazyCommands(TyperGroup):
    """The commands that are always imported, and those of `COMMANDS`."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names, those from elsewhere last."""
        return [*super().list_commands(ctx), *COMMANDS]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of this name; None if there is none."""
        if cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name)
        module, name = COMMANDS[cmd_name]
        found = getattr(import_module(module), name)
        if isinstance(found, typer.Typer):
            return typer.main.get_command(found)
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(cmd_name)(found)
        return typer.main.get_command(alone)
