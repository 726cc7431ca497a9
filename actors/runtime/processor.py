"""The processor, and fingerprints of its arithmetic; for messages, never in a digest."""

import functools
import hashlib
import platform
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

import msgspec

_FEATURES: Final = frozenset({
    "sse2", "sse42", "avx", "avx2", "fma3", "avx512f", "avx512_skx", "x86_v3", "x86_v4",
    "neon", "asimd", "sve",
})  # fmt: skip
"""Features that select code paths, by numpy's names in lower case."""


class Processor(msgspec.Struct, frozen=True):
    """A processor as named in recordings."""

    architecture: str
    model: str = ""
    features: tuple[str, ...] = ()
    """Arithmetic extensions found by numpy, sorted; empty if numpy is not loaded."""

    def __str__(self) -> str:
        model = f" ({self.model})" if self.model else ""
        features = f" with {', '.join(self.features)}" if self.features else ""
        return f"{self.architecture}{model}{features}"


def processor() -> Processor:
    """Return this computer's processor."""
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
    """Return the model name from cpuinfo; on ARM maybe only the maker's numbers."""
    fields: dict[str, str] = {}
    for line in lines:
        name, _, value = line.partition(":")
        fields.setdefault(name.strip(), value.strip())
    if model := fields.get("model name") or fields.get("Model"):
        return model
    maker, part = fields.get("CPU implementer"), fields.get("CPU part")
    return f"implementer {maker}, part {part}" if maker and part else ""


_SHORT: Final = 16
"""Hexadecimal digits of a hash in a message."""


class KernelModule(Protocol):
    """A module with numeric kernels."""

    __name__: str

    def __hash__(self) -> int: ...

    def fingerprint(self) -> bytes | dict[str, bytes]:
        """Return the kernels' results for fixed inputs, together or by function."""


def fingerprints(modules: Iterable[KernelModule]) -> dict[str, str]:
    """Return the SHA-256 of each module's fingerprint, by module or function name.

    Computed once per process and its forks.
    """
    return dict(pair for module in modules for pair in _hashed(module))


def combine_fingerprints(prints: Mapping[str, str]) -> str:
    """Return the fingerprints as text for a message, shortened."""
    return "\n".join(f"{name}={value[:_SHORT]}" for name, value in sorted(prints.items()))


def parse_fingerprints(text: str) -> dict[str, str]:
    """Parse the text of `combine_fingerprints`; drop invalid names."""
    pairs = (line.partition("=") for line in text.split("\n"))
    return {name: value for name, _, value in pairs if re.fullmatch(r"[\w. ]{1,100}", name, re.ASCII)}


def differing_kernels(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Return the sorted names of kernels with different results; kernels on one side only are ignored."""
    return sorted(name for name in there.keys() & here.keys() if there[name] != here[name])


def first_names(names: Sequence[str]) -> str:
    """Return the first three names, for a sentence."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def difference_cause(there: Processor, here: Processor, names: list[str]) -> str:
    """Return the likely cause of results that differ from the recording; "" if unknown.

    `names`: differing kernels, see `differing_kernels`.
    """
    if names:
        if there == here:
            return f"recorded with another version of this software: results of {first_names(names)} differ"
        cause = f"results of {first_names(names)} differ"
        return f"recorded on another processor: {cause}; it was {there}, this is {here}"
    if there != here and there.architecture:
        return f"recorded on another processor, {there}; this is {here}, with equal results of all kernels"
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
