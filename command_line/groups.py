"""The root of the command line: its commands under headings, and what has become of earlier ones."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from actors.installation.usage import OptionError
from command_line.lazy import WithLazyCommands

FOR_DEVELOPERS: Final = "Commands for those who change the testbed"
_OTHERS: Final = "Commands"
MOVED: Final[Mapping[tuple[str, ...], str]] = MappingProxyType(
    {
        ("deploy", "keys"): "fleet keys",
        ("deploy", "units"): "fleet units",
        ("deploy",): "fleet",
        ("doctor",): "fleet doctor",
        ("onboard",): "fleet onboard",
        ("watch", "--stop"): "fleet stop",
        ("watch", "--pause"): "fleet pause",
        ("watch", "--resume"): "fleet resume",
        ("watch",): "fleet watch",
        ("collect",): "fleet collect",
        ("strategies",): "list strategies",
    }
)
"""What was called otherwise, by its first words in any order; the first one that fits counts."""


class Root(WithLazyCommands):
    """Commands under headings (`rich_help_panel`); one that is called otherwise now is named as it is."""

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

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command, its name and what follows. Raises OptionError where it is called otherwise now."""
        if not ctx.resilient_parsing and (moved := _moved(args)):
            was, now = moved
            raise OptionError(f"{was}: is no longer a command; it is acrc {now} now")
        return super().resolve_command(ctx, args)


def _moved(words: Sequence[str]) -> tuple[str, str] | None:
    """What a command was called, and is called now; None if it is called as it was."""
    for was, now in MOVED.items():
        if words[0] == was[0] and set(was) <= set(words):
            return " ".join(was), now
    return None
