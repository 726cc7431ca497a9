"""This processor, and this processor without some of its instructions."""

import sys
from typing import Final

import numpy as np

from actors.runtime.processor import processor
from benchmarks.processors.computer import Computer

NO_FMA: Final = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX2_Usable,-FMA,-FMA_Usable,-AVX512F"}
"""glibc then takes the functions that it has for older processors."""
GENERIC: Final = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
"""numba then compiles for any processor of the architecture."""


def no_avx512() -> dict[str, str]:
    """What makes numpy leave AVX-512 alone; empty where it has none."""
    umath = np._core._multiarray_umath  # type: ignore[attr-defined]
    wide = [name for name in umath.__cpu_dispatch__ if name.startswith(("AVX512", "X86_V4"))]
    present = [name for name in wide if umath.__cpu_features__.get(name)]
    return {"NPY_DISABLE_CPU_FEATURES": " ".join(present)} if present else {}


def computers() -> list[Computer]:
    """As it is, and each part of the arithmetic as an older processor would have it."""
    here, python = processor(), (sys.executable,)
    model = here.model or "unnamed"
    version = f"Python {sys.version_info.major}.{sys.version_info.minor}"
    numpy = no_avx512()
    left = Computer("numpy without AVX-512", missing="this processor or numpy has no AVX-512")
    if numpy:
        left = Computer("numpy without AVX-512", python, numpy)
    return [
        Computer(f"{here.architecture} ({model}), {version}", python),
        left,
        Computer("glibc without AVX2 and FMA", python, NO_FMA),
        Computer("numba for any processor", python, GENERIC),
        Computer("all three", python, {**numpy, **NO_FMA, **GENERIC}),
    ]
