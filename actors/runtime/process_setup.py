"""What an actor's process is started with: one struct in one file, `setup.json` in the actor's folder.

World, radio and robots read the same kind of file, and so do base and bridge on board. In memory nobody reads
a file: the struct is handed over as it is.
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
"""The file, in the actor's folder of the run."""
RecordDetail = Literal["lean", "full"]
"""How much an actor records: `lean` has what results and causes need, `full` also what it computed, for
viewers and exports. A set-up without it is of an earlier version, which recorded lean."""
A = TypeVar("A")
P = TypeVar("P", bound="ProcessSetup")


class ProcessSetup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A process's place in a run. Paths are relative to the folder of the set-up, and may be absolute."""

    record: str
    """The MCAP file to write; must not exist."""
    router: str
    """The router's socket; for the router itself the file that says whom it knows."""
    credentials: str = ""
    """File with one line `user:password`; the router needs none."""
    commit: str = ""
    """Version of the software, for the first record."""
    with_parent: bool = False
    """End as soon as the process that started this one has ended."""

    @property
    def patience_s(self) -> float:
        """How long the router may take to be there, s; who is looked after waits until he is ended."""
        return math.inf if self.with_parent else 30.0

    def endpoint(self, folder: Path) -> str:
        """Of the router, as Zenoh spells it; the set-up lies in `folder`."""
        # A socket's path has room for a hundred characters, of which none are to be spent on `..`.
        return unix_endpoint(Path(os.path.normpath(folder.resolve() / self.router)))


class ActorSetup(msgspec.Struct, Generic[A, P], frozen=True, forbid_unknown_fields=True):
    """All of the file: what the actor is, which its recording begins with, and its process's place."""

    actor: A
    process: P


def read_setup(path: Path, kind: type[ActorSetup[A, P]], actor: str) -> ActorSetup[A, P]:
    """The set-up of what is called `actor`, such as "a robot", in a file. Raises AcrcError."""
    return typed_json.read(path, kind, f"set-up of {actor}")


def located_model(model: str, folder: Path) -> str:
    """A robot model as a set-up in `folder` names it: the path of a file, or the name of a shipped one."""
    return str(folder / model) if model.endswith(".toml") else model


class ArgumentParser(argparse.ArgumentParser):
    """An argparse parser whose errors are sentences for the caller to show."""

    def error(self, message: str) -> NoReturn:
        """Raise AcrcError instead of printing the usage and exiting."""
        raise AcrcError(f"{self.prog}: {message}")


def setup_parser(program: str, description: str) -> ArgumentParser:
    """The command line of a process that reads a set-up: one word, the file."""
    parser = ArgumentParser(prog=f"python -m {program}", description=description)
    parser.add_argument("setup", type=Path, help="its set-up, setup.json in its folder of the run")
    return parser
