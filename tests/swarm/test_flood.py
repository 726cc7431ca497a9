"""A robot cannot stop the run by filling what others read: it is named at once."""

import re
from pathlib import Path

import pytest

from tests.swarm.command import acrc, leftovers, processes_of


@pytest.mark.parametrize(("entry", "reader"), [("ready", "world"), ("transmit", "radio")])
def test_a_flood_ends_the_run_and_names_who_sent_it(tmp_path: Path, entry: str, reader: str) -> None:
    out = tmp_path / "out"
    done = acrc("run", "--robots", 2, "--strategy", f"tests.swarm.flooder:{entry}", "--out", out)
    assert done.returncode == 1
    assert re.fullmatch(
        rf"acrc: {reader} failed in step 1[01]: r2 floods swarm/up/r2/{entry}: 1001 messages of together "
        r"[0-9]+ bytes wait and nobody has asked for them; at most 1000 of together 67108864 may wait",
        done.stderr.strip().splitlines()[-1],
    )
    assert processes_of(out) == [] and leftovers(out) == []
