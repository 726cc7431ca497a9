"""The packages that constraints.txt pins, section by section, as they apply to one Python."""

import re
from collections.abc import Collection
from typing import Final, NamedTuple

MINORS: Final = (11, 12, 13, 14)
"""Of Python 3: constraints.txt has the hashes of their wheels, for Linux on x86-64 and ARM."""
_PIN: Final = re.compile(
    r"(?P<name>[A-Za-z0-9_.-]+)==(?P<version>[^\s;]+)"
    r"(?:; python_version (?P<order><|>=) \"3\.(?P<minor>\d+)\")?(?P<hashes>(?: +--hash=\S+)*) *"
)


class Pin(NamedTuple):
    """One package at the one version that is tested."""

    name: str
    version: str
    hashes: tuple[str, ...]
    """Of its files, as pip's option `--hash` has them."""

    @property
    def requirement(self) -> str:
        """As a line of a requirements file."""
        return " ".join([f"{self.name}=={self.version}", *(f"--hash={one}" for one in self.hashes)])


def sections(constraints: str, minor: int) -> dict[str, list[Pin]]:
    """The pins in the text of constraints.txt that apply to Python 3.`minor`, by section."""
    found: dict[str, list[Pin]] = {}
    for line in constraints.replace("\\\n", " ").splitlines():
        if header := re.fullmatch(r"# \[(\w+)\]", line):
            pins = found.setdefault(header[1], [])
        elif (pin := _PIN.fullmatch(line)) and _applies(pin, minor):
            hashes = (word.removeprefix("--hash=") for word in pin["hashes"].split())
            pins.append(Pin(pin["name"], pin["version"], tuple(hashes)))
    return found


def requirements(constraints: str, minor: int, wanted: Collection[str]) -> list[str]:
    """Lines for pip, sorted: the pins of the `wanted` sections with their hashes, each once."""
    found = sections(constraints, minor)
    return sorted({pin.requirement for name in wanted for pin in found[name]})


def _applies(pin: re.Match[str], minor: int) -> bool:
    return pin["order"] is None or (minor < int(pin["minor"])) is (pin["order"] == "<")
