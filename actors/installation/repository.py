"""Where this project lies: it is installed as a link to its sources; maps and scenarios are beside them."""

from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parents[2]

PACKAGES: Final = frozenset(
    {
        "actors",
        "benchmarks",
        "cleaning",
        "command_line",
        "deeco",
        "deploy",
        "experiments",
        "firmware_bridge",
        "observation",
    }
)
"""What is installed of it (pyproject.toml); whatever else lies here is not this project's code."""
