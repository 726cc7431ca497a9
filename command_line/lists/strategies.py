"""Which strategies can be named."""

import contextlib
import inspect
import sys

import msgspec

from actors.robot.behaviour.entry import entry_function
from actors.runtime.errors import AcrcError
from cleaning.strategies import Strategy, strategies
from command_line.lists.rows import print_rows


class ListedStrategy(msgspec.Struct, frozen=True):
    """A strategy that can be named."""

    name: str
    entry: str
    """Entry string `module:function` of its behaviour."""
    source: str
    """"shipped", or name and version of the distribution that registers it."""
    summary: str
    """First line of the function's docstring."""
    error: str
    """Why it cannot be used; empty if it can, as far as importing it shows."""


def listed() -> tuple[ListedStrategy, ...]:
    """All strategies, each imported; one that is broken does not keep the others from being listed."""
    with contextlib.redirect_stdout(sys.stderr):  # what a module prints must not come between
        return tuple(map(_listed, strategies()))


def print_strategies(*, json: bool) -> None:
    """Print them on standard output."""
    rows = listed()
    columns = {
        "name": [row.name for row in rows],
        "from": [row.source for row in rows],
        "what it does, and its entry": [f"{row.error or row.summary}\n{row.entry}" for row in rows],
    }
    print_rows(rows, columns, json=json)


def _listed(strategy: Strategy) -> ListedStrategy:
    summary = error = ""
    try:
        summary = (inspect.getdoc(entry_function(strategy.entry)) or "").partition("\n")[0]
    except AcrcError as fault:
        error = str(fault)
    except (Exception, SystemExit) as fault:
        error = f"cannot be imported: {type(fault).__name__}: {fault}"
    return ListedStrategy(strategy.name, strategy.entry, strategy.source, summary, strategy.fault or error)
