"""Computers that a run is made on: this processor, and this one without some of its instructions."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from actors.installation.repository import REPOSITORY
from actors.runtime.processor import processor

_LAST_WORDS: Final = 200
"""Characters of a failed command's last line that are told."""


@dataclass(frozen=True)
class Computer:
    """Where a run is made; without a command it cannot be made, and `missing` says why."""

    name: str
    command: tuple[str, ...] = ()
    """Starts Python."""
    environment: Mapping[str, str] = field(default_factory=dict)
    """Added to ours."""
    missing: str = ""


@dataclass(frozen=True)
class RunTask:
    """A run to be made everywhere."""

    title: str
    scenario: Path
    seconds: float
    robots: int | None = None
    """None: the scenario's."""
    navigation: str | None = None
    """Preset of navigation; None: the scenario's."""

    def words(self, out: Path) -> list[str]:
        """The command line after `acrc`."""
        robots = [] if self.robots is None else ["--robots", str(self.robots)]
        navigation = [] if self.navigation is None else ["--navigation", self.navigation]
        words = ["run", str(self.scenario), "--duration", f"{self.seconds:g}", *robots, *navigation]
        return [*words, "--bus", "memory", "--json", "--out", str(out)]


@dataclass(frozen=True)
class RunOutcome:
    """What became of a task on a computer."""

    digest: str
    """Empty if there is none."""
    fault: str = ""
    wall_s: float = 0.0
    """Compiling included."""
    ran: bool = True
    """False: there is no such computer here."""


def make(task: RunTask, computer: Computer, folder: Path, patience_s: float) -> RunOutcome:
    """Make the run; its files and the compiled kernels go to `folder`."""
    if not computer.command:
        return RunOutcome("", computer.missing, ran=False)
    # compiled once for all rows of one Python: a key tells processors, sources and releases of numba apart
    kernels = folder / "kernels" / _file_name(computer.command[-1])
    out = folder / f"{_file_name(computer.name)}-{task.title}-{time.time_ns()}"
    folder.mkdir(parents=True, exist_ok=True)
    environment = {
        **os.environ,
        "PYTHONPATH": str(REPOSITORY),
        "NUMBA_CACHE_DIR": str(kernels),
        **computer.environment,
    }
    begun = time.monotonic()
    try:
        done = subprocess.run(
            [*computer.command, "-m", "command_line", *task.words(out)],
            cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=False, timeout=patience_s,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        return RunOutcome("", f"not run: {type(error).__name__}")
    wall = round(time.monotonic() - begun, 1)
    if done.returncode:
        return RunOutcome("", last_words(done.stderr), wall)
    return RunOutcome(json.loads(done.stdout)["digest"], "", wall)


def last_words(text: str) -> str:
    """The last line of what a failed command said."""
    lines: Sequence[str] = text.strip().splitlines() or ["without a word"]
    return f"failed: {lines[-1][:_LAST_WORDS]}"


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in ".-" else "_" for c in name)


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


def here() -> list[Computer]:
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
