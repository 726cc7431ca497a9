"""Library interface of the testbed: run scenarios, open runs, read tables, draw, compare campaigns.

`import acrc_testbed as acrc` is the only import that a notebook needs; see docs/library.md. All errors are
`AcrcError`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import actors  # noqa: F401  # first import: sets the order of sys.path

if TYPE_CHECKING:
    from acrc_testbed.campaigns import Campaign, campaign, open_campaign
    from acrc_testbed.checks import check_strategy, check_task
    from acrc_testbed.runs import Run, open_run, run, side_by_side
    from actors.runtime.errors import AcrcError

__all__ = [
    "AcrcError",
    "Campaign",
    "Run",
    "campaign",
    "check_strategy",
    "check_task",
    "open_campaign",
    "open_run",
    "run",
    "side_by_side",
]

_MODULES: Final = {
    **dict.fromkeys(("Campaign", "campaign", "open_campaign"), "acrc_testbed.campaigns"),
    **dict.fromkeys(("Run", "side_by_side", "open_run", "run"), "acrc_testbed.runs"),
    **dict.fromkeys(("check_strategy", "check_task"), "acrc_testbed.checks"),
    "AcrcError": "actors.runtime.errors",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use: the command line needs none of them."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__
