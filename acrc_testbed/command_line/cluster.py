"""`acrc cluster`: computers that work together, by Dask's own programs."""

import os
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from acrc_testbed.command_line.options import Json, answer
from actors.runtime.errors import AcrcError

app = typer.Typer(
    help="Start a cluster, add this computer to one, fetch what it has kept.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)

Address = Annotated[
    str,
    typer.Argument(
        metavar="ADDRESS", help="Of the scheduler: tls://HOST:PORT, or tcp://127.0.0.1:PORT on this computer."
    ),
]


@app.command()
def start(address: Address) -> None:
    """Start a cluster's scheduler here, until Ctrl-C.

    It listens at the address, by which others reach this computer.
    """
    from deploy.clusters.address import host_and_port, plain

    place = plain(address, "ADDRESS")
    host, port = host_and_port(place)
    protocol = place.partition("://")[0]
    _become("dask_scheduler", "--protocol", protocol, "--host", host, "--port", str(port))


@app.command()
def join(
    address: Address,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=1024, help="Number of workers.  [default: one per core]"),
    ] = None,
) -> None:
    """Let a cluster use this computer, until Ctrl-C.

    The first time it installs and compiles what that needs.
    """
    from actors.processes.kernels import compile_kernels
    from deploy.clusters.address import plain
    from deploy.clusters.connection import PATIENCE_S, security

    place = plain(address, "ADDRESS")
    if place.startswith("tls://"):
        security(place, PATIENCE_S, "ADDRESS")  # what is wrong with the certificates is said in a sentence
    compile_kernels()
    local = ("--host", "127.0.0.1") if place.startswith("tcp://") else ()
    number = workers or len(os.sched_getaffinity(0))
    _become("dask_worker", place, *local, "--nworkers", str(number), "--nthreads", "1")


@app.command()
def fetch(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a run over several computers.")],
    on: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of its cluster's scheduler.  [default: as the run had it]"),
    ] = None,
    json: Json = False,
) -> None:
    """Bring what a run has left on other computers, and remove it there."""
    from acrc_testbed.recordings.topics import goes_on
    from deploy.clusters.address import plain
    from deploy.hosts.files import fetch

    address = plain(on) if on else ""
    if not (out / "run.json").is_file() and goes_on(out):
        raise AcrcError(f"{out}: the run is going on; must have ended")
    fetched = fetch(out, address, _say)
    what = "1 file has come" if fetched.files == 1 else f"{fetched.files} files have come"
    answer([f"{what}, {fetched.bytes} B"], asdict(fetched), json=json)


def _say(sentence: str) -> None:
    sys.stderr.write(f"acrc: {sentence}\n")


def _become(program: str, *words: str) -> NoReturn:
    command = [sys.executable, "-P", "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(sys.executable, command)
