"""ps and top say which process of a run is which."""

from pathlib import Path

import pytest

from tests.failures.failing import stepping, until
from tests.swarm.command import ROOT, begin, processes_of


@pytest.mark.parametrize("isolation", ["--isolate", "--no-isolate"])
def test_every_process_is_called_by_what_it_is(tmp_path: Path, isolation: str) -> None:
    out = tmp_path / "out"
    corridor = ROOT / "scenarios" / "corridor.toml"
    process = begin("run", corridor, "--robots", 2, "--duration", 100_000, isolation, "--out", out)
    try:
        until(lambda: stepping(out), timeout_s=90.0)
        about = [Path(f"/proc/{pid}") for pid in processes_of(out) if pid != process.pid]
        names = {(folder / "comm").read_text().strip() for folder in about}
        lines = {(folder / "cmdline").read_bytes().rstrip(b"\0").decode() for folder in about}
        assert names == lines == {"acrc world", "acrc radio", "acrc r1", "acrc r2"}
    finally:
        process.terminate()
        process.communicate(timeout=30)
