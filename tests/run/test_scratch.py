"""Temporary files where there is no room for them: the folder that is full is named, and no other."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from actors.processes import scratch
from actors.processes.scratch import scratch_folder
from actors.runtime.errors import AcrcError
from tests.small_disk import on_small_disk

ROOT = Path(__file__).parents[2]
SAID = (
    "{}: temporary files cannot be written: no space left on device; make room there, or set TMPDIR to "
    "another folder"
)


def test_it_is_gone_afterwards_and_what_has_another_cause_is_passed_on() -> None:
    with pytest.raises(ZeroDivisionError), scratch_folder() as folder:
        (folder / "a").write_text("a")
        raise ZeroDivisionError
    assert not folder.exists()
    for error in (OSError(errno.ENOSPC, "No space left on device"), AcrcError("r1 failed")):
        with pytest.raises(type(error)) as caught, scratch_folder():
            raise error
        assert caught.value is error, "there is room here"


def test_a_full_folder_is_named_whoever_finds_it_full(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch, "write_fault", lambda folder: "no space left on device")
    with pytest.raises(AcrcError) as caught, scratch_folder() as folder:
        raise OSError(errno.ENOSPC, "No space left on device")
    said = SAID.format(folder.parent)
    assert str(caught.value) == said
    with pytest.raises(AcrcError) as caught, scratch_folder():
        raise AcrcError("r1 ended without a word")
    assert str(caught.value) == f"r1 ended without a word; {said}"


def test_a_system_without_any_place_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(prefix: str) -> None:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr("tempfile.TemporaryDirectory", nowhere)
    monkeypatch.setenv("TMPDIR", "/somewhere")
    with pytest.raises(AcrcError) as caught, scratch_folder():
        raise AssertionError
    assert str(caught.value) == (
        "/somewhere: temporary files cannot be written: no usable temporary directory found in ['/tmp']; "
        "make room there, or set TMPDIR to another folder"
    )


def test_a_run_whose_tmpdir_is_full_does_not_blame_its_own_folder(tmp_path: Path) -> None:
    full, out = tmp_path / "full", tmp_path / "out"
    command = (sys.executable, "-P", "-m", "command_line", "run", "--robots", "1", "--duration", "1")
    words = on_small_disk(full, "8k", [*command, "--out", str(out)])
    env = {**os.environ, "TMPDIR": str(full)}
    done = subprocess.run(words, cwd=ROOT, env=env, capture_output=True, text=True, check=False, timeout=100)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.splitlines()[-1] == f"acrc: {SAID.format(full)}"
    assert not out.exists()
