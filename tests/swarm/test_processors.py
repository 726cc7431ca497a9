"""A run has one digest whatever the processor can do: here with some of its instructions switched off."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from actors.runtime.process import RunNote
from actors.runtime.recording import read_notes
from benchmarks.processors.computer import NO_FMA, no_avx512
from tests.swarm.command import run

TASK = (REPOSITORY / "scenarios" / "corridor.toml", "--bus", "memory", "--robots", 3, "--duration", 6)
"""Robots that see, localise, drive and talk; where they touch, the fingerprints must do."""


def kernels(out: Path) -> dict[str, dict[str, str]]:
    """The fingerprints of each actor's kernels."""
    notes = {path.stem: read_notes(path)["run"] for path in sorted(out.glob("*/*.mcap"))}
    return {actor: msgspec.json.decode(note, type=RunNote).kernels for actor, note in notes.items()}


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    out = tmp_path_factory.mktemp("as-it-is") / "out"
    return out, run(out, *TASK)


@pytest.mark.parametrize("without", ["AVX-512 in numpy", "AVX2 and FMA in glibc"])
def test_one_digest_whatever_the_processor_can_do(
    without: str, reference: tuple[Path, dict[str, Any]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    environment = NO_FMA if "glibc" in without else no_avx512()
    if not environment:
        pytest.skip("this processor, or numpy on it, has no AVX-512")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    found = run(tmp_path / "out", *TASK)
    first, expected = reference
    assert expected["frames"]["copies_heard"] > 0 and "actors.world.physics" in kernels(first)["world"]
    assert kernels(tmp_path / "out") == kernels(first)
    assert found["digest"] == expected["digest"]
