"""Set-up of an actor's process: one struct in one file, `setup.json` in the actor's folder.

World, radio and robots use the same file format, and so do base and bridge on a robot. In-memory runs pass
the struct directly.
"""

import argparse
import math
import os
from pathlib import Path
from typing import Final, Generic, Literal, NoReturn, TypeVar

import msgspec

from actors.runtime import typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import unix_endpoint

SETUP: Final = "setup.json"
"""File name in the actor's folder of the run."""
RecordDetail = Literal["lean", "full"]
"""Detail of recordings: `lean` for results and causes, `full` with introspection for viewers and exports.
Set-ups of earlier versions lack it and are lean."""
A = TypeVar("A")
P = TypeVar("P", bound="ProcessSetup")


class ProcessSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A process's connections and files. Paths are absolute or relative to the folder of the set-up."""

    record: str
    """MCAP file to write; must not exist."""
    router: str
    """The router's socket; for the router itself, the router file."""
    credentials: str = ""
    """File with one line `user:password`; empty for the router."""
    commit: str = ""
    """Version of the software, for the first record."""
    with_parent: bool = False
    """Exit when the parent process exits."""

    @property
    def patience_s(self) -> float:
        """Timeout for connecting to the router, s; infinite for a process whose parent monitors it."""
        return math.inf if self.with_parent else 30.0

    def endpoint(self, folder: Path) -> str:
        """Return the router's endpoint in Zenoh's notation, for a set-up in `folder`."""
        # Normalised because a socket's path is limited to about a hundred characters.
        return unix_endpoint(Path(os.path.normpath(folder.resolve() / self.router)))


class ActorSetup(msgspec.Struct, Generic[A, P], frozen=True, forbid_unknown_fields=True):
    """Content of the file: the actor's parameters, which its recording starts with, and its process."""

    actor: A
    process: P


def read_setup(path: Path, kind: type[ActorSetup[A, P]], actor: str) -> ActorSetup[A, P]:
    """Read the set-up of `actor`, such as "a robot", from a file. Raises AcrcError."""
    return typed_json.read(path, kind, f"set-up of {actor}")


def resolve_model(model: str, folder: Path) -> str:
    """Return the robot model named in a set-up in `folder`: a file's path or a shipped model's name."""
    return str(folder / model) if model.endswith(".toml") else model


class ArgumentParser(argparse.ArgumentParser):
    """An argparse parser that raises its errors."""

    def error(self, message: str) -> NoReturn:
        """Raise AcrcError instead of printing the usage and exiting."""
        raise AcrcError(f"{self.prog}: {message}")


def setup_parser(program: str, description: str) -> ArgumentParser:
    """Return the parser of a process that reads a set-up: one argument, the file."""
    parser = ArgumentParser(prog=f"python -m {program}", description=description)
    parser.add_argument("setup", type=Path, help="set-up file: setup.json in the actor's folder")
    return parser
