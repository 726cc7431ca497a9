"""Which processor this is, and what of it arithmetic may depend on: for people, never in a digest."""

import functools
import hashlib
import platform
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, Protocol

import msgspec

_FEATURES: Final = frozenset({
    "sse2", "sse42", "avx", "avx2", "fma3", "avx512f", "avx512_skx", "x86_v3", "x86_v4",
    "neon", "asimd", "sve",
})  # fmt: skip
"""Those whose presence changes which code is run, as numpy names them, in lower case."""


class Processor(msgspec.Struct, frozen=True):
    """A processor, as a recording names it."""

    architecture: str
    model: str = ""
    features: tuple[str, ...] = ()
    """Extensions of its arithmetic that numpy found, by name, sorted; none where numpy is not loaded."""

    def __str__(self) -> str:
        model = f" ({self.model})" if self.model else ""
        features = f" with {', '.join(self.features)}" if self.features else ""
        return f"{self.architecture}{model}{features}"


def processor() -> Processor:
    """This one."""
    return Processor(platform.machine(), _model(Path("/proc/cpuinfo")), _features())


def _features() -> tuple[str, ...]:
    loaded = sys.modules.get("numpy._core._multiarray_umath")
    known: dict[str, bool] = getattr(loaded, "__cpu_features__", {})
    names = {name.lower() for name, present in known.items() if present}
    return tuple(sorted(names & _FEATURES))


def _model(cpuinfo: Path) -> str:
    try:
        return _model_in(cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines())
    except OSError:
        return ""


def _model_in(lines: Iterable[str]) -> str:
    """The first name that the kernel gives; on ARM there may be numbers of the maker only."""
    fields: dict[str, str] = {}
    for line in lines:
        name, _, value = line.partition(":")
        fields.setdefault(name.strip(), value.strip())
    if model := fields.get("model name") or fields.get("Model"):
        return model
    maker, part = fields.get("CPU implementer"), fields.get("CPU part")
    return f"implementer {maker}, part {part}" if maker and part else ""


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
