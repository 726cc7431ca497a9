"""Campaigns that are killed at random moments: whether what was resumed is what was never interrupted."""

import json
import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from benchmarks.statistics.commands import ACRC, answer
from benchmarks.statistics.measured import Measured, table_of

_LOOK_S: Final = 0.02


def check(runs: int = 10, duration: float = 20.0, seed: int = 1) -> Measured:
    """Kill a campaign so often, and resume it; it holds where each record is as without, and made once.

    The campaign has the strategies none and chapter, two robots, and as many seeds, `duration` simulated s
    each. `seed`: from which the moments are drawn.
    """
    words = (
        *("--strategies", "none,chapter", "--seeds", str(runs), "--robots", "2"),
        *("--duration", f"{duration:g}", "--check-every", "0", "--json"),
    )
    rng, rows, kept = random.Random(seed), [], dict[str, int]()
    with tempfile.TemporaryDirectory(prefix="acrc-") as name:
        whole, cut = Path(name) / "whole", Path(name) / "cut"
        answer("campaign", *words, "--out", str(whole))
        each_s = _lasted_s(whole) / runs
        stayed = True
        for number in range(1, runs + 1):
            after_s = rng.uniform(0.0, 2 * each_s)
            over = _kill((*words, "--out", str(cut)), cut, after_s)
            there = _times(cut)
            same = kept.items() <= there.items()
            rows.append({"kill": number, "after s": f"{after_s:.1f}", "runs kept": len(there), "over": over})
            stayed, kept = stayed and same, there
        answer("campaign", *words, "--out", str(cut))
        stayed = stayed and kept.items() <= _times(cut).items()
        equal = _digests(whole) == _digests(cut)
    title = f"records as without any kill: {equal}; none made twice or changed: {stayed}"
    return Measured(rows, (table_of(rows, title),), equal and stayed)


def _kill(words: tuple[str, ...], folder: Path, after_s: float) -> bool:
    """Begin, and kill so long after a run has begun; True if all was over by then."""
    began_ns = time.time_ns()
    with subprocess.Popen(
        [*ACRC, "campaign", *words], cwd=REPOSITORY, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        while process.poll() is None and not any(
            at > began_ns for at in _times(folder, "logs/*.log").values()
        ):
            time.sleep(_LOOK_S)
        try:
            process.wait(after_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            return False
    return True


def _times(folder: Path, files: str = "trials/*.json") -> dict[str, int]:
    """When each of these files, the records if nothing else is said, was written, ns."""
    found = {}
    for path in folder.glob(files):
        with suppress(FileNotFoundError):
            found[path.name] = path.stat().st_mtime_ns
    return found


def _lasted_s(folder: Path) -> float:
    """From the beginning of a campaign's first run to the end of its last."""
    begun = (folder / "study.json").stat().st_mtime_ns
    return (max(_times(folder).values()) - begun) / 1e9


def _digests(folder: Path) -> Mapping[str, str]:
    """By the record's file."""
    records = {path.name: json.loads(path.read_bytes()) for path in folder.glob("trials/*.json")}
    return {name: record["result"]["digest"] for name, record in records.items()}
