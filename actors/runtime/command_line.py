"""The command line of an actor's process."""

import argparse
from pathlib import Path
from typing import NoReturn

from actors.runtime.errors import AcrcError


class ArgumentError(AcrcError):
    """A command line that does not say what the actor needs."""


class ArgumentParser(argparse.ArgumentParser):
    """An argparse parser whose errors are sentences for the caller to show."""

    def error(self, message: str) -> NoReturn:
        """Raise ArgumentError instead of printing the usage and exiting."""
        raise ArgumentError(f"{self.prog}: {message}")


def setup_parser(program: str, description: str) -> ArgumentParser:
    """The command line of a process that reads a set-up: one word, the file."""
    parser = ArgumentParser(prog=f"python -m {program}", description=description)
    parser.add_argument("setup", type=Path, help="its set-up, setup.json in its folder of the run")
    return parser
