"""The command line. What a command needs is imported once it is known which one it is."""

import difflib
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

from acrc_testbed.command_line import development, look, replaying, run
from acrc_testbed.command_line.fleet import app as fleet
from acrc_testbed.command_line.lists import app as listing
from acrc_testbed.command_line.record import app as record
from actors.console import screen
from actors.installation.usage import OptionError, extras_named
from actors.processes.signals import Interrupted, signals_as_interrupts
from actors.runtime.errors import AcrcError, printable


class StreamError(AcrcError):
    """Standard output that cannot be written."""


def settle() -> None:
    """Make standard output and error such that nobody who listens to neither is a fault.

    A stream that is closed leads nowhere from now on, and so does a pipe once nobody reads it any more.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file to be opened must not get this number, and be written to
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _stream(1, sys.stdout)
    sys.stderr = _stream(2, sys.stderr)


class _Pipe(io.FileIO):
    """A descriptor that drops what it cannot write; that is said once, unless nobody wants to read it."""

    dead = False

    def write(self, data: Any) -> int:
        """As for any file; StreamError."""
        try:
            return len(memoryview(data).cast("B")) if self.dead else super().write(data)
        except BrokenPipeError:
            self.dead = True
            return len(memoryview(data).cast("B"))
        except OSError as error:
            self.dead = True
            if self.fileno() != 1:
                return len(memoryview(data).cast("B"))  # nothing else is left to say it on
            words = (error.strerror or str(error)).lower()
            raise StreamError(f"standard output cannot be written: {words}") from None


def _stream(number: int, present: Any) -> io.TextIOWrapper:
    """The same as `present`, but for who may be gone at its other end."""
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
    "cluster": ("acrc_testbed.command_line.fleet", "cluster"),
    "campaign": ("acrc_testbed.command_line.experiments", "campaign"),
    "causes": ("acrc_testbed.command_line.experiments", "causes"),
    "compare": ("acrc_testbed.command_line.experiments", "compare"),
    "bundle": ("acrc_testbed.command_line.experiments", "bundle"),
    "report": ("acrc_testbed.command_line.experiments", "report"),
    "study": ("acrc_testbed.command_line.experiments", "study_app"),
    "docs": ("acrc_testbed.command_line.documentation", "docs"),
    "verify": ("acrc_testbed.command_line.bench", "verify"),
    "bench": ("acrc_testbed.command_line.bench", "bench"),
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


_NUMBERS: Final = {"int": "a whole number", "float": "a number"}


def text(error: typer.TyperException) -> str:
    """What is to be said: a sentence, or the help where no command was given."""
    if isinstance(error, faults.NoArgsIsHelpError):
        return error.format_message()
    return f"acrc: {printable(_sentence(error))}"


def _sentence(error: typer.TyperException) -> str:
    context: Any = getattr(error, "ctx", None)
    command = context.command_path if context else "acrc"
    match error:
        case faults.NoSuchOption():
            return _unknown_option(error, command, context)
        case faults.BadOptionUsage():
            return _usage(error)
        case faults.MissingParameter():
            return f"{_name(error)}: is missing; {command} --help says what it is"
        case faults.BadParameter():
            return _value(error)
    return _other(error, command, context)


def _other(error: typer.TyperException, command: str, context: Any) -> str:
    if named := re.match(r"No such command '(.*?)'\.", error.message):
        return _unknown_command(named[1], command, context)
    if named := re.match(r"Got unexpected extra argument\(s\) \((.*)\)", error.message, re.DOTALL):
        form = " ".join(context.get_usage().removeprefix("Usage: ").split())
        return f"{command.removeprefix('acrc ')}: has no use for {named[1]}; must be as in {form}"
    return f"{command.removeprefix('acrc ')}: {error.format_message()}"


_REMOVED_OPTIONS: Final = {
    f"acrc view {option}": "acrc explain OUT ROBOT@SECONDS replays a robot and explains its decisions"
    for option in ("--why", "--modules", "--trust", "--isolate", "--no-isolate")
}


def _unknown_option(error: faults.NoSuchOption, command: str, context: Any) -> str:
    if right := _REMOVED_OPTIONS.get(f"{command} {error.option_name}"):
        return f"{error.option_name}: is no option of {command} any more; {right}"
    near = error.possibilities or []
    right = f"did you mean {near[0]}?" if near else f"{command} --help lists those that there are"
    return f"{error.option_name}: is no option of {command}; {right}"


def _usage(error: faults.BadOptionUsage) -> str:
    if error.message.endswith("does not take a value."):
        return f"{error.option_name}: has a value; must stand alone"
    return f"{error.option_name}: has no value; must be followed by one"


def _unknown_command(name: str, command: str, context: Any) -> str:
    known = context.command.list_commands(context)
    near = difflib.get_close_matches(name, known, n=1)
    right = f"did you mean {near[0]}?" if near else f"must be one of {', '.join(known)}"
    return f"{name}: is no command of {command}; {right}"


def _value(error: faults.BadParameter) -> str:
    value = re.match(r"'?(.*?)'? is not (?:a valid|in the range)", error.message, re.DOTALL)
    if error.param is None or value is None:
        return f"{error.param_hint or 'acrc'}: {error.message}"
    return f"{_name(error)}: {value[1]}; must be {_right(error)}"


def _name(error: faults.BadParameter) -> str:
    """The option as it is written, or what stands for the argument in the help."""
    parameter: Any = error.param
    if parameter.param_type_name == "argument":
        return str(parameter.metavar).removesuffix("…")
    return str(max(parameter.opts, key=len))


def _right(error: faults.BadParameter) -> str:
    """Return what a value must be, by the kind and the bounds that the option declares."""
    kind: Any = error.param.type  # type: ignore[union-attr]
    words = _NUMBERS.get(kind.name.removesuffix(" range"))
    if words is None:
        return str(error.message)
    bounds = [
        f" {word} {bound:g}"
        for word, bound in (("from", getattr(kind, "min", None)), ("to", getattr(kind, "max", None)))
        if bound is not None
    ]
    return f"{words}{''.join(bounds)}"


app = typer.Typer(
    name="acrc",
    cls=Root,
    help="A testbed for self-adaptation: cleaning robots that can talk by radio only.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(run.run)
app.command()(run.branch)
app.command(context_settings={"ignore_unknown_options": True})(run.order)
app.command()(look.demo)
app.command()(look.view)
app.command()(look.scenario)
app.command()(replaying.replay)
app.command()(replaying.explain)
app.command()(replaying.export)
app.add_typer(record, name="record", help="Read and check what a run recorded.")
app.add_typer(listing, name="list", help="List strategies, presets, robot models, scenarios and maps.")
app.add_typer(fleet, name="fleet", help="Set up real robots, start, watch and stop them.")
app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    rich_help_panel=FOR_DEVELOPERS,
)(development.test)
app.command(rich_help_panel=FOR_DEVELOPERS)(development.check)


def main() -> None:
    """Run the command line; what is wrong is a line on standard error and exit code 1, or 2 for its words."""
    settle()
    gc.set_threshold(20_000, 20, 20)  # what a command imports stays: looking for garbage in it takes a tenth
    try:
        with signals_as_interrupts(), extras_named():
            sys.exit(app(_words(sys.argv[1:]), prog_name="acrc", standalone_mode=False))
    except Interrupted as interrupt:
        _say("acrc: ended from outside" + _kept(interrupt))
        sys.exit(interrupt.exit_code)
    except AcrcError as error:
        _say(f"acrc: {error}")
        sys.exit(2 if isinstance(error, OptionError) else 1)
    except typer.TyperException as error:
        _say(text(error))
        sys.exit(error.exit_code)


def _words(typed: list[str]) -> list[str]:
    """Return the words to parse: `acrc help run` is `acrc run --help`. Raises OptionError."""
    for name in (*typed, os.path.realpath(".")):
        if not name.isascii() and any("\ud800" <= character <= "\udfff" for character in name):
            raise OptionError(f"{name!r}: the name is not UTF-8, as names in results must be; rename it")
    return [*typed[1:], "--help"] if typed[:1] == ["help"] else typed


def _kept(interrupt: Interrupted) -> str:
    return f"; what was recorded is in {interrupt.recorded}" if interrupt.recorded else ""


def _say(text: str) -> None:
    screen(stderr=True).print(text)


def _print_version(wished: bool) -> None:
    if wished:
        from actors.installation import version

        release, software = version.release(), version.software()
        print(f"acrc {release}" + (f", commit {software}" if software != release else ""))
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Say which version and commit this is."
        ),
    ] = False,
) -> None:
    """What holds for every command."""


@app.command()
def add(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME…", help="As pip knows them: pandas, pandas==3.0.0.")
    ],
) -> None:
    """Install packages that your strategies import.

    They are added to requirements.txt of this clone.
    """
    raise OptionError(f"add {' '.join(names)}: is done by the script itself; call ./acrc of this clone")
