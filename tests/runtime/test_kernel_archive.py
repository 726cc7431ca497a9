"""The machine code in the repository is that of the sources, and is unpacked or left alone."""

import lzma
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from actors import kernel_dispatchers
from actors.kernel_sources import module_state
from actors.processes.kernel_compilation import archived_modules, compile_archived
from actors.runtime.recording import scans
from cleaning import visits

COMMAND = f"{sys.executable} -m actors.processes.kernel_compilation"
LOAD = """
from actors.floor import raster
from actors.runtime import processor
from actors.runtime.recording import scans
from cleaning import visits
print(processor.fingerprints([raster, scans, visits]))
for module in (raster, scans, visits):
    for name, value in vars(module).items():
        assert not getattr(value, "stats", None) or not value.stats.cache_misses, name
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(kernel_dispatchers, "unpack_kernels", kernel_dispatchers.unpack_kernels.__wrapped__)
    return tmp_path / "kernels"


def test_the_archive_is_that_of_the_sources() -> None:
    archived = kernel_dispatchers.read_archive()[kernel_dispatchers.PYTHON]
    modules = archived_modules()
    assert {f"{one}-{module_state(one)}" for one in modules} <= archived.keys(), f"outdated; run {COMMAND}"
    assert len(archived) < len(modules) + 3, f"more than the current state; run {COMMAND}"
    path = re.compile(rb"(?<![\w.-])/\w[\w./-]*\.py")
    found = [path.findall(code) for one in archived.values() for code in one.values()]
    assert len(found) > 60 and not any(found), "paths of the computer that compiled them"


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_a_compilation_gives_the_bytes_of_the_archive() -> None:
    modules = archived_modules()
    assert compile_archived(modules) == kernel_dispatchers.read_archive()[kernel_dispatchers.PYTHON]


def test_unpacked_kernels_are_loaded_without_compilation(cache: Path) -> None:
    found = subprocess.run([sys.executable, "-c", LOAD], check=True, stdout=subprocess.PIPE, text=True).stdout
    assert repr(scans.__name__) in found and visits.__name__ in found, "unpacked by the first kernel"
    assert kernel_dispatchers.unpack_kernels() >= {*archived_modules()}
    files = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbc")}
    assert files == {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbc")}, "written once"


def test_without_a_valid_archive_and_without_a_cache_nothing_is_unpacked(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = kernel_dispatchers.ARCHIVE.read_bytes()
    archive = tmp_path / "archive.xz"
    monkeypatch.setattr(kernel_dispatchers, "ARCHIVE", archive)
    assert kernel_dispatchers.unpack_kernels() == set(), "no file"
    outdated = {kernel_dispatchers.PYTHON: {"cleaning.visits-0123456789abcdef": {"x": b""}}}
    for content in (b"", whole[:5000], lzma.compress(b"x"), lzma.compress(msgspec.msgpack.encode(outdated))):
        archive.write_bytes(content)
        assert kernel_dispatchers.unpack_kernels() == set() and not [*cache.rglob("*.nbc")]
    archive.write_bytes(whole)
    cache.parent.joinpath("file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert kernel_dispatchers.unpack_kernels() == set(), "no folder for the cache"
