"""The command line. What a command needs is imported once it is known which one it is."""

import gc
import os
import sys
from typing import Annotated

import typer

from actors.console import screen
from actors.installation.usage import OptionError, extras_named
from actors.processes.signals import Interrupted, signals_as_interrupts
from actors.runtime.errors import AcrcError
from command_line import exporting, look, replaying, run, streams, usage_errors
from command_line.development import commands as development
from command_line.fleet import app as fleet
from command_line.groups import FOR_DEVELOPERS, Root
from command_line.lists import app as listing
from command_line.record import app as record

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
app.command()(exporting.export)
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
    streams.settle()
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
        _say(usage_errors.text(error))
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
