"""The root of the command line: its commands under headings."""

from typing import Any, Final

from command_line.lazy import WithLazyCommands

FOR_DEVELOPERS: Final = "Commands for those who change the testbed"
_OTHERS: Final = "Commands"


class Root(WithLazyCommands):
    """Commands under headings (`rich_help_panel`)."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """A list of commands for each heading."""
        known = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        limit = formatter.width - 6 - max(len(name) for name, _ in known)
        sections: dict[str, list[tuple[str, str]]] = {_OTHERS: []}
        for name, command in known:
            heading = getattr(command, "rich_help_panel", None) or _OTHERS
            sections.setdefault(heading, []).append((name, command.get_short_help_str(limit)))
        for heading, rows in sections.items():
            with formatter.section(heading):
                formatter.write_dl(rows)
