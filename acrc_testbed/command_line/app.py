"""Root command `acrc`; the modules of most commands are imported when they are called."""

import gc
import io
import os
import re
import sys
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from typer._click import exceptions as faults
from typer.core import TyperGroup

from acrc_testbed.command_line.shared_options import suggestion
from actors.installation.usage import OptionError, missing_extra_named
from actors.processes.signals import Interruption, signals_as_interrupts
from actors.runtime.errors import AcrcError, printable


class StreamError(AcrcError):
    """Standard output that cannot be written."""


def protect_standard_streams() -> None:
    """Make closed standard streams, and pipes without a reader, discard output."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: otherwise the next opened file would get this number, and the output
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _protected_stream(1, sys.stdout)
    sys.stderr = _protected_stream(2, sys.stderr)


class _Pipe(io.FileIO):
    """A descriptor that drops output after a failed write; the first failure raises unless a pipe broke."""

    dead = False

    def write(self, data: Any) -> int:
        """Write as to any file. Raises StreamError."""
        if not self.dead:
            try:
                return super().write(data)
            except OSError as error:
                self.dead = True
                if self.fileno() == 1 and not isinstance(error, BrokenPipeError):
                    reason = (error.strerror or str(error)).lower()
                    raise StreamError(f"standard output cannot be written: {reason}") from None
        return len(memoryview(data).cast("B"))


def _protected_stream(number: int, present: Any) -> io.TextIOWrapper:
    """Return a stream like `present` over a `_Pipe`."""
    if present is not None:
        present.flush()
    raw = _Pipe(number, "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=getattr(present, "encoding", "utf-8"),
        errors="backslashreplace",
        line_buffering=number == 2 or raw.isatty(),
    )


COMMANDS: Final = {
    name: f"acrc_testbed.command_line.{module}"
    for module, names in (
        ("run", ("run", "branch", "order")),
        ("visualisation", ("demo", "view", "scenario")),
        ("replay_commands", ("replay", "explain", "export")),
        ("development", ("test", "check")),
        ("app", ("add",)),
        ("record", ("record",)),
        ("lists", ("list",)),
        ("fleet", ("fleet", "cluster")),
        ("experiments", ("campaign", "causes", "compare", "gap", "bundle", "report", "study")),
        ("documentation", ("docs",)),
        ("bench", ("verify", "bench")),
    )
    for name in names
}
"""Module of each command, which has a function or a `typer.Typer` of the command's name, or that as `app`."""


FOR_DEVELOPERS: Final = "Commands for developers of the testbed"
_OTHERS: Final = "Commands"
_ANY_OPTIONS: Final = {"ignore_unknown_options": True}
_SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "order": {"context_settings": _ANY_OPTIONS},
    "test": {
        "context_settings": {"allow_extra_args": True, **_ANY_OPTIONS},
        "rich_help_panel": FOR_DEVELOPERS,
    },
    "check": {"rich_help_panel": FOR_DEVELOPERS},
}
"""Settings of commands other than typer's defaults."""


class RootCommand(TyperGroup):
    """The commands of `COMMANDS`, imported when called, listed under headings (`rich_help_panel`)."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return [*COMMANDS]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of this name; None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        module = import_module(COMMANDS[cmd_name])
        found = getattr(module, cmd_name, None) or module.app
        if isinstance(found, typer.Typer):
            return typer.main.get_command(found)
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(cmd_name, **_SETTINGS.get(cmd_name, {}))(found)
        return typer.main.get_command(alone)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a list of commands for each heading."""
        known = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        limit = formatter.width - 6 - max(len(name) for name, _ in known)
        sections: dict[str, list[tuple[str, str]]] = {_OTHERS: []}
        for name, command in known:
            heading = getattr(command, "rich_help_panel", None) or _OTHERS
            sections.setdefault(heading, []).append((name, command.get_short_help_str(limit)))
        for heading, rows in sections.items():
            with formatter.section(heading):
                formatter.write_dl(rows)


_NUMBERS: Final = {"int": "a whole number", "float": "a number"}


def usage_error(error: typer.TyperException) -> str:
    """Return a usage error in one sentence, or the help where no command was given."""
    if isinstance(error, faults.NoArgsIsHelpError):
        return error.format_message()
    context: Any = getattr(error, "ctx", None)
    command = context.command_path if context else "acrc"
    match error:
        case faults.NoSuchOption():
            matches = error.possibilities or []
            hint = f"did you mean {matches[0]}?" if matches else f"see {command} --help"
            sentence = f"{error.option_name}: unknown option of {command}; {hint}"
        case faults.BadOptionUsage() if error.message.endswith("does not take a value."):
            sentence = f"{error.option_name}: takes no value"
        case faults.BadOptionUsage():
            sentence = f"{error.option_name}: requires a value"
        case faults.MissingParameter():
            sentence = f"{_parameter_name(error.param)}: missing; see {command} --help"
        case faults.BadParameter():
            sentence = _value_error(error)
        case _:
            sentence = _command_error(error, command, context)
    return f"acrc: {printable(sentence)}"


def _command_error(error: typer.TyperException, command: str, context: Any) -> str:
    if named := re.match(r"No such command '(.*?)'\.", error.message):
        known = context.command.list_commands(context)
        return f"{named[1]}: unknown command of {command}; {suggestion(named[1], known)}"
    if named := re.match(r"Got unexpected extra argument\(s\) \((.*)\)", error.message, re.DOTALL):
        usage = " ".join(context.get_usage().removeprefix("Usage: ").split())
        return f"{command.removeprefix('acrc ')}: unexpected argument {named[1]}; usage: {usage}"
    return f"{command.removeprefix('acrc ')}: {error.format_message()}"


def _value_error(error: faults.BadParameter) -> str:
    """Return a wrong value with the type and bounds that the option declares."""
    value = re.match(r"'?(.*?)'? is not (?:a valid|in the range)", error.message, re.DOTALL)
    if error.param is None or value is None:
        return f"{error.param_hint or 'acrc'}: {error.message}"
    kind: Any = error.param.type
    expected = _NUMBERS.get(kind.name.removesuffix(" range"))
    if expected is None:
        expected = error.message
    else:
        for word, bound in (("from", getattr(kind, "min", None)), ("to", getattr(kind, "max", None))):
            expected += "" if bound is None else f" {word} {bound:g}"
    return f"{_parameter_name(error.param)}: {value[1]}; must be {expected}"


def _parameter_name(parameter: Any) -> str:
    """Return the long form of an option, or the metavar of an argument."""
    if parameter.param_type_name == "argument":
        return str(parameter.metavar).removesuffix("…")
    return str(max(parameter.opts, key=len))


app = typer.Typer(
    name="acrc",
    cls=RootCommand,
    help="A testbed for self-adaptation: cleaning robots that communicate by radio only.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def main() -> None:
    """Run the command line; an error is one line on standard error and exit code 1, or 2 for wrong usage."""
    protect_standard_streams()
    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # before numpy, whose import takes twice as long with more
    gc.set_threshold(500_000, 10, 10)  # imported modules are never garbage; scanning them costs 10 %
    try:
        with signals_as_interrupts(), missing_extra_named():
            sys.exit(app(_arguments(sys.argv[1:]), prog_name="acrc", standalone_mode=False))
    except Interruption as interrupt:
        recorded = f"; recordings are in {interrupt.recorded}" if interrupt.recorded else ""
        sentence, code = f"acrc: interrupted{recorded}", interrupt.exit_code
    except AcrcError as error:
        sentence, code = f"acrc: {error}", 2 if isinstance(error, OptionError) else 1
    except typer.TyperException as error:
        sentence, code = usage_error(error), error.exit_code
    from actors.console import create_console

    create_console(stderr=True).print(sentence)
    sys.exit(code)


def _arguments(typed: list[str]) -> list[str]:
    """Return the arguments to parse: `acrc help run` is `acrc run --help`. Raises OptionError."""
    for name in (*typed, os.path.realpath(".")):
        if not name.isascii() and any("\ud800" <= character <= "\udfff" for character in name):
            raise OptionError(f"{name!r}: not UTF-8, which results require of names; rename it")
    return [*typed[1:], "--help"] if typed[:1] == ["help"] else typed


def _print_version(requested: bool) -> None:
    if requested:
        from actors.installation import version

        release, software = version.package_version(), version.software_version()
        print(f"acrc {release}" + (f", commit {software}" if software != release else ""))
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option("--version", is_eager=True, callback=_print_version, help="Print version and commit."),
    ] = False,
) -> None:
    """Accept the options of `acrc` itself."""


def add(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME…", help="Packages, as for pip: pandas, pandas==3.0.0.")
    ],
) -> None:
    """Install packages that your strategies import.

    Add them to requirements.txt of this clone.
    """
    raise OptionError(f"add {' '.join(names)}: requires the script of a clone; call ./acrc there")
