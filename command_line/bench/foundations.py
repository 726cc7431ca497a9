"""On the command line: the component model, portable functions, processors, parsers, isolation."""

from pathlib import Path
from typing import Annotated

import typer

from actors.installation.repository import REPOSITORY
from command_line.options import Json


def deeco(json: Json = False) -> None:
    """Measure the component model: memberships, processes, the chapter's robot among peers."""
    from benchmarks.foundations import deeco as model

    model.run(json)


def portable(
    arguments: Annotated[
        int, typer.Option(metavar="N", min=1, max=1_000_000, help="Of each kind, for the largest error.")
    ] = 5000,
    json: Json = False,
) -> None:
    """Measure the portable functions: error against exact values, time beside the C library's."""
    from benchmarks.foundations import portable as functions

    functions.run(arguments, json)


def processors(
    duration: Annotated[
        float, typer.Option(metavar="S", min=1, max=3600, help="Simulated seconds of the chapter's run.")
    ] = 600.0,
    crowd: Annotated[
        float, typer.Option(metavar="S", min=1, max=3600, help="Simulated seconds of the house test's run.")
    ] = 50.0,
    install: Annotated[
        bool, typer.Option("--install", help="Let apt-get install qemu and debootstrap if they are missing.")
    ] = False,
    folder: Annotated[
        Path, typer.Option(metavar="DIR", help="Where what is built is kept.", show_default=False)
    ] = REPOSITORY / ".processors",
    only: Annotated[
        list[str] | None, typer.Option(metavar="WORD", help="Only what is so called. May be repeated.")
    ] = None,
    json: Json = False,
) -> None:
    """Compare the digests of two runs over processors, their features and Pythons; aarch64 in an emulator."""
    from benchmarks.processors import table

    raise typer.Exit(table.run(duration, crowd, install, folder.absolute(), json, only or ()))


def mutations(
    size: Annotated[
        int, typer.Option("--bytes", metavar="N", min=1, help="Damaged bytes for each parser.")
    ] = 10_000_000,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the damage.")] = 1,
    json: Json = False,
) -> None:
    """Feed every parser of files, messages, frames and serial lines with damaged bytes."""
    from benchmarks.mutations import command

    command.run(size, json, seed)


def attacks(json: Json = False) -> None:
    """Try every known way between robots past the radio, and say what held and what got through."""
    from benchmarks.attacks import command

    command.run(json)
