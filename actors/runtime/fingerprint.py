"""What the numeric kernels give on fixed inputs here: the alarm, should a processor compute otherwise."""

import functools
import hashlib
import re
from collections.abc import Iterable, Mapping
from typing import Final, Protocol

from actors.runtime.processor import Processor

_SHORT: Final = 16
"""Digits of a hash in a message."""


class KernelModule(Protocol):
    """A module with kernels."""

    __name__: str

    def __hash__(self) -> int: ...

    def fingerprint(self) -> bytes | dict[str, bytes]:
        """The bytes that its kernels give on fixed inputs, together or by function."""


def fingerprints(modules: Iterable[KernelModule]) -> dict[str, str]:
    """The sha256 of each module's fingerprint, by the name of the module or of the function in it.

    Computed once in a process and those forked from it: code and processor stay what they are.
    """
    return dict(pair for module in modules for pair in _hashed(module))


def combined(prints: Mapping[str, str]) -> str:
    """All of them in a text that a message holds, shortened."""
    return "\n".join(f"{name}={value[:_SHORT]}" for name, value in sorted(prints.items()))


def parted(text: str) -> dict[str, str]:
    """What `combined` made, whoever sent it; drops names of more than letters, digits, dots, blanks."""
    pairs = (line.partition("=") for line in text.split("\n"))
    return {name: value for name, _, value in pairs if re.fullmatch(r"[\w. ]{1,100}", name, re.ASCII)}


def otherwise(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """What computes otherwise there than here, by name, sorted; what only one of them has is left out."""
    return sorted(name for name in there.keys() & here.keys() if there[name] != here[name])


def few(names: list[str]) -> str:
    """The first of them for a sentence."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def difference(there: Processor, here: Processor, names: list[str]) -> str:
    """In words what may be the cause of other bits than were recorded; "" if nothing speaks for one.

    `names`: what computes otherwise, see `otherwise`.
    """
    if names:
        if there == here:
            return f"recorded with another version of this software: other bits come from {few(names)}"
        cause = f"other bits come from {few(names)}"
        return f"recorded on another processor: {cause}; it was {there}, this is {here}"
    if there != here and there.architecture:
        return f"recorded on another processor, {there}; this is {here}, and its functions give the same bits"
    return ""


@functools.cache
def _hashed(module: KernelModule) -> tuple[tuple[str, str], ...]:
    given = module.fingerprint()
    if isinstance(given, bytes):
        return ((module.__name__, hashlib.sha256(given).hexdigest()),)
    return tuple(
        (f"{module.__name__}.{function}", hashlib.sha256(result).hexdigest())
        for function, result in given.items()
    )
