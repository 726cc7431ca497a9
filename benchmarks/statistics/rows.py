"""Prints what a benchmark has found: a table for people, or JSON for programs."""

import json
import sys
from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Table


def print_rows(rows: Sequence[Mapping[str, object]], title: str, *, json_output: bool) -> None:
    """Print the rows, at least one, on standard output; each has the same columns, by name, in this order."""
    if json_output:
        sys.stdout.write(json.dumps(rows) + "\n")
        return
    table = Table(*rows[0], title=title)
    for row in rows:
        table.add_row(*map(str, row.values()))
    Console().print(table)
