"""Where this project lies: it is installed as a link to its sources; maps and scenarios are beside them."""

from pathlib import Path
from typing import Final

REPOSITORY: Final = Path(__file__).resolve().parent.parent

PACKAGES: Final = frozenset(
    {"actors", "benchmarks", "cleaning", "deeco", "deploy", "documentation", "experiments", "firmware_bridge"}
)
"""What is installed of it (pyproject.toml); whatever else lies here is not this project's code."""
