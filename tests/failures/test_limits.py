"""What one robot's process may have ends before the machine does, and is named with the strategy's line."""

import re
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.runtime.isolation.resource_limits import LimitError, ProcessLimits, limits
from deploy.run.options import RunOptions, checked
from tests.swarm.command import acrc, leftovers, processes_of


def test_limits_as_words() -> None:
    assert limits(("memory_mb=1500", "processes=9")) == ProcessLimits(memory_mb=1500, processes=9)
    assert limits(()) == ProcessLimits()


@pytest.mark.parametrize("word", ["memory_mb", "memory_mb=0", "disk=3", "file_mb=1e9"])
def test_a_limit_that_is_none_is_refused(word: str) -> None:
    with pytest.raises(LimitError) as caught:
        limits((word,))
    assert str(caught.value) == (
        f"--limit: {word}; must be one of memory_mb, open_files, file_mb, disk_mb, disk_files, processes, "
        '"=" and a number from 1 to 999999999'
    )


def test_limits_and_a_timeout_that_do_not_fit_the_other_options(tmp_path: Path) -> None:
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path / "out", bus="memory"), ("file_mb=1",))
    assert str(caught.value) == "--limit: requires --bus zenoh; it limits a simulated robot's process"
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path / "out"), ("file_mb",))
    assert str(caught.value).startswith("--limit: file_mb; must be one of memory_mb, ")
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path / "out", speed="0.02", timeout_s=5.0))
    assert str(caught.value) == "--timeout: 5; must be more than the 5 s of a step at --speed 0.02"


@pytest.mark.parametrize("pieces", ["hoards", pytest.param("hoards_crumbs", marks=pytest.mark.nightly)])
def test_a_strategy_that_takes_all_memory_ends_the_run_and_is_named(tmp_path: Path, pieces: str) -> None:
    out = tmp_path / "out"
    words = ("--robots", 2, "--duration", 4, "--limit", "memory_mb=2000", "--timeout", 60)
    done = acrc("run", "--strategy", f"tests.failures.saboteur:{pieces}", *words, "--out", out)
    assert done.returncode == 1
    # without memory for the innermost frames an outer one is named (tests/run/test_reserve.py)
    place = r"saboteur.py:\d+" if pieces == "hoards" else r"\w+.py:\d+"
    assert re.search(rf"acrc: r2 failed in step 20: MemoryError( \({place}\))?\n$", done.stderr)
    assert processes_of(out) == [] and leftovers(out) == []


def test_a_strategy_that_fills_the_disk_ends_the_run_and_is_named(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("--robots", 2, "--duration", 4, "--isolate", "--limit", "disk_mb=30")
    done = acrc("run", "--strategy", "tests.failures.saboteur:fills", *words, "--out", out)
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1] == (
        f"acrc: r2 has written more than 30 MB to {out}/r2; --limit disk_mb=N allows more"
    )
    assert processes_of(out) == [] and leftovers(out) == []
