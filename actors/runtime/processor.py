"""The processor, and fingerprints of its arithmetic; for messages, never in a digest."""

import functools
import hashlib
import os
import platform
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final, Protocol

import msgspec

from actors.kernel_sources import module_state
from actors.kernels import cache_folder, write_file
from actors.runtime.regular_file import read_bytes

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
_MAX_BYTES: Final = 1 << 16
_Hashes = Annotated[
    dict[str, Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]], msgspec.Meta(min_length=1)
]
_VARIABLES: Final = re.compile(r"GLIBC_TUNABLES|(?:LD|NPY|NUMBA|NUMPY|OPENBLAS|OMP|MKL|BLIS)_.*")
"""Environment variables that select code paths."""
_CPU: Final = re.compile(rb"(?m)^(?:vendor|cpu (?!MHz)|model|stepping|microcode|flags|Features|CPU).*")
"""Lines of /proc/cpuinfo that are constant."""
_LIBRARY: Final = re.compile(rb"(?m)/\S*/(?:lib(?:m|c|python)[-.\d]\S*|python[\d.]*|_multiarray_umath\S*)$")
"""Mapped files that compute."""


class KernelModule(Protocol):
    """A module with numeric kernels."""

    __name__: str

    def __hash__(self) -> int: ...

    def fingerprint(self) -> bytes | dict[str, bytes]:
        """Return the kernels' results for fixed inputs, together or by function."""


_known: Final[dict[KernelModule, dict[str, str]]] = {}
"""Hashes in this process."""


def fingerprints(modules: Iterable[KernelModule], *, saved: bool = False) -> dict[str, str]:
    """Return the SHA-256 of each module's fingerprint, by module or function name.

    Computed once per process and its forks, which loads the kernels. `saved`: use those that a process with
    the same sources, processor and libraries has computed; kernels are then loaded once they are called.
    """
    found: dict[str, str] = {}
    for module in modules:
        if module not in _known:
            _known[module] = _saved(module) if saved else _hashed(module)
        found |= _known[module]
    return found


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


def _hashed(module: KernelModule) -> dict[str, str]:
    """Return the hashes by module or function name, in the order of the functions."""
    given, name = module.fingerprint(), module.__name__
    results = {name: given} if isinstance(given, bytes) else {f"{name}.{one}": given[one] for one in given}
    return {one: hashlib.sha256(result).hexdigest() for one, result in results.items()}


def _saved(module: KernelModule) -> dict[str, str]:
    """Return the hashes from the cache of kernels; if it has no valid file of them, compute and save them."""
    state, environment = module_state(module.__name__), _arithmetic()
    if state is None or environment is None:
        return _hashed(module)
    path = cache_folder() / f"{module.__name__}-{state}" / f"{environment}.fingerprint"
    with suppress(OSError, msgspec.MsgspecError):
        return msgspec.json.decode(read_bytes(path, _MAX_BYTES), type=_Hashes)
    found = _hashed(module)
    write_file(path, msgspec.json.encode(found))
    return found


@functools.cache
def _arithmetic() -> str | None:
    """Return a hash of everything beside the sources that may change results; None: unknown.

    Processor, libraries with their files, the variables that configure them, rounding and small numbers.
    """
    small, unit = sys.float_info.min, sys.float_info.epsilon
    numpy = sys.modules.get("numpy._core._multiarray_umath")
    try:
        mapped = [Path(os.fsdecode(one)) for one in _LIBRARY.findall(Path("/proc/self/maps").read_bytes())]
        packages = [Path(one) for one in sys.path if one.endswith("-packages")]
        cpu = sorted({*_CPU.findall(Path("/proc/cpuinfo").read_bytes())})
        files = {path: path.stat() for path in sorted({*mapped, *packages})}
    except OSError:
        return None
    parts = (
        platform.machine(), sys.version, sys.flags.optimize, cpu, getattr(numpy, "__cpu_features__", {}),
        [(str(path), one.st_size, one.st_mtime_ns) for path, one in files.items()],
        sorted(item for item in os.environ.items() if _VARIABLES.fullmatch(item[0])),
        (small / 2 * 2, 1.0 + unit * 0.75, 1.0 + unit * 0.25),
    )  # fmt: skip
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:_SHORT]
