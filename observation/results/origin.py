"""What a result comes from: enough to make it again, and to know what it was made with."""

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

import msgspec

_PACKAGES: Final = ("eclipse-zenoh", "llvmlite", "msgspec", "numba", "numpy", "pymunk")
"""Those that a run's result, or its speed, could depend on."""


class BranchOrigin(msgspec.Struct, frozen=True):
    """The run that another one is a branch of."""

    run: str
    """Its folder."""
    digest: str
    at_s: float
    """Where the branch leaves it, simulated s."""
    changes: tuple[str, ...] = ()
    """What was changed, as it was typed."""
    difference: str = ""
    """The first message that came out otherwise: step, key, field, both values; empty if none did."""
    control: str = ""
    """Digest of the control, for a branch with other settings: its strategy made anew with its own values."""
    control_difference: str = ""
    """The first message that came out otherwise than in the control; empty if none did, or without one."""


class Origin(msgspec.Struct, frozen=True):
    """Scenario, strategy and software of a run; scenario, seed, key and commit together determine its
    digest.
    """

    scenario: str = ""
    """Name of the scenario's file; its content, with everything drawn, lies beside the result."""
    strategy: str = ""
    """As the scenario or `--strategy` says."""
    behaviour: str = ""
    """The function that this name stands for, `module:function`."""
    settings: dict[str, Any] = {}
    """Of the strategy, as the scenario says; what is absent is as the strategy has it."""
    commit: str = ""
    """Of this software, with a plus sign where files were changed since; its version outside a clone."""
    versions: dict[str, str] = {}
    """Of Python and of the packages that matter."""
    key: str = ""
    """What all that is random follows from beside the seed; empty: there is none."""
    navigation: str = ""
    """Preset of navigation, as the scenario or `--navigation` says; empty in results that do not say it."""
    localisation: str = ""
    """Preset of localisation; the same."""
    branch: BranchOrigin | None = None
    """Of a branch: where it comes from; its scenario, seed and commit do not determine its digest alone."""


UNKNOWN: Final = Origin()
"""Of what is no whole run."""


def versions() -> dict[str, str]:
    """Of Python, and of each package that is installed."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
