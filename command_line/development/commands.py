"""`acrc test` and `acrc check`, for those who change the testbed."""

import os
from pathlib import Path

import typer

from actors.console import screen
from actors.installation.repository import clone
from command_line.development.checks import run_checks
from command_line.development.suite import run_suite


def test(context: typer.Context) -> None:
    """Run the tests; arguments go to pytest (-h: its help)."""
    root = clone("test")
    words = [_absolute(word) for word in context.args]
    here = str(Path.cwd())
    os.environ["PYTHONPATH"] = here  # nothing else: a sourced ROS brings plugins for pytest
    from actors.processes.kernels import compile_kernels

    compile_kernels()  # or the first tests would wait for it, and see it said where a result is due
    raise typer.Exit(run_suite(root, words))


def check() -> None:
    """Check style, types and imports of the sources."""
    if not run_checks(clone("check"), screen()):
        raise typer.Exit(1)


def _absolute(word: str) -> str:
    """An argument that names a file, or a test in one, as it is found from any folder."""
    path, colons, name = word.partition("::")
    return f"{Path(path).absolute()}{colons}{name}" if Path(path).exists() else word
