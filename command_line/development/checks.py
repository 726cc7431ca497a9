"""The checks that every change must pass: form, faults, arithmetic, types, and who may import whom."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.text import Text


@dataclass(frozen=True)
class Check:
    """A program that says whether the sources are in order."""

    name: str
    command: tuple[str, ...]
    """Arguments of this Python."""


CHECKS: Final = (
    Check("ruff format --check", ("-m", "ruff", "format", "--check", ".")),
    Check("ruff check", ("-m", "ruff", "check", ".")),
    Check("portable arithmetic", ("-m", "command_line.development.portability")),
    Check("mypy", ("-m", "mypy")),
    Check("lint-imports", ("-c", "import sys; from importlinter import cli; cli.lint_imports_command()")),
)


def run_checks(root: Path, console: Console, checks: tuple[Check, ...] = CHECKS) -> bool:
    """Run every check in the folder `root`, also after one has failed; True if all are content."""
    failed = []
    for check in checks:
        console.rule(Text(check.name, style="bold"), align="left")
        if subprocess.run([sys.executable, *check.command], cwd=root, check=False).returncode:
            failed.append(check.name)
    console.rule(align="left")
    if failed:
        console.print(f"{len(failed)} of {len(checks)} checks failed: {', '.join(failed)}", style="bold red")
    else:
        console.print(f"all {len(checks)} checks passed: {', '.join(c.name for c in checks)}", style="green")
    return not failed
