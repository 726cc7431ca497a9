"""Which processor this is, and what of it arithmetic may depend on: for people, never in a digest."""

import platform
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

_FEATURES: Final = frozenset(
    {
        "sse2",
        "sse42",
        "avx",
        "avx2",
        "fma3",
        "avx512f",
        "avx512_skx",
        "x86_v3",
        "x86_v4",
        "neon",
        "asimd",
        "sve",
    }
)
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
