"""The options that every actor process shares, on its command line."""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from actors.runtime.errors import AcrcError
from actors.runtime.spans import Window, add_span_option


class ArgumentError(AcrcError):
    """A command line that does not say what the actor needs."""


class ArgumentParser(argparse.ArgumentParser):
    """An argparse parser whose errors are sentences for the caller to show."""

    def error(self, message: str) -> NoReturn:
        """Raise ArgumentError instead of printing the usage and exiting."""
        raise ArgumentError(f"{self.prog}: {message}")


@dataclass(frozen=True)
class ClientOptions:
    """An actor process's place in a run."""

    router: str
    """Endpoint of the router, such as `unixsock-stream//run/acrc/r1/router.sock`."""
    credentials: Path
    """File with one line `user:password`."""
    record: Path
    """The MCAP file to write; must not exist."""
    commit: str
    """Version of the software, for the first record."""
    with_parent: bool
    """End as soon as the process that started this one has ended."""
    spans: Window | None = None
    """Steps in which what it does is noted, span by span."""
    spares_record: bool = False
    """Go on where the disk takes no record any more: on board, where stopping would cost more."""

    @property
    def patience_s(self) -> float:
        """How long the router may take to be there, s; who is looked after waits until he is ended."""
        return math.inf if self.with_parent else 30.0


def own_folder(folder: Path) -> Path:
    """In the folder of an actor, the part that it may write to, and that no other process writes to or reads.

    What others rely on lies beside it: recordings and logs, which the actor keeps open and cannot replace.
    """
    return folder / "own"


def add_client_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that `client_options` reads."""
    parser.add_argument("--router", required=True, help="endpoint of the router")
    parser.add_argument("--credentials", required=True, type=Path, help="file with one line user:password")
    parser.add_argument("--record", required=True, type=Path, help="MCAP file to write")
    parser.add_argument("--commit", default="", help="version of the software, for the first record")
    parser.add_argument("--with-parent", action="store_true", help="end when the starting process ends")
    parser.add_argument("--spare-record", action="store_true", help="go on where the disk is full")
    add_span_option(parser)


def client_options(options: argparse.Namespace) -> ClientOptions:
    """The shared options out of a parsed command line."""
    return ClientOptions(
        options.router,
        options.credentials,
        options.record,
        options.commit,
        options.with_parent,
        options.spans,
        options.spare_record,
    )
