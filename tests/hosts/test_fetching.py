"""Files left on a run's host: what a worker serves, and rejection of invalid answers."""

import hashlib
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from acrc_testbed.results import seal
from acrc_testbed.results.seal import HostPart, HostsFile, RemoteFile
from actors.runtime.errors import AcrcError
from deploy.hosts import files as fetching
from deploy.hosts.files import TASK, FetchedFiles, HostFile, fetch

RUN = "0123456789abcdef"
FILES = {"r1/r1.mcap": b"recorded" * 700_000, "r1/r1.log": b"said\n", "r1/r1.1.mcap": b"", "r2/r2.mcap": b"r"}


@pytest.fixture
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = tmp_path / "acrc-x"
    for name, data in FILES.items():
        (folder / "run" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "run" / name).write_bytes(data)
    for name in ("run/r1/setup.json", "run/.router/passwords", "run/r1/own/r1.mcap"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("not for others")
    (folder / TASK).write_bytes(msgspec.json.encode({"run": RUN, "robots": ["r1", "r2"]}))
    return folder


def told(folder: Path, name: str = "r1/r1.mcap", data: bytes = FILES["r1/r1.mcap"]) -> HostsFile:
    left = RemoteFile("h", len(data), hashlib.sha256(data).hexdigest())
    part = HostPart("10.0.0.2", 2, ("r1", "r2"), str(folder))
    return HostsFile("tls://10.0.0.1:8786", RUN, {"h": part}, {name: left})


@pytest.fixture
def out(there: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the run's folder on this computer, with a cluster whose worker answers correctly."""
    answers(monkeypatch, lambda function, *words: function(*words))
    folder = tmp_path / "runs" / "one"
    folder.mkdir(parents=True)
    seal.write_hosts(folder, told(there))
    return folder


def answers(monkeypatch: pytest.MonkeyPatch, answer: Callable[..., Any]) -> None:
    def submit(function: Callable[..., Any], *words: Any, **how: Any) -> SimpleNamespace:
        assert how["workers"] == ["tls://10.0.0.2:4000"]
        return SimpleNamespace(done=lambda: True, result=lambda: answer(function, *words))

    client = SimpleNamespace(submit=submit)
    monkeypatch.setattr(fetching, "connected", lambda address: nullcontext(client))
    monkeypatch.setattr(fetching, "host_workers", lambda client: ["tls://10.0.0.2:4000"])


def quiet(sentence: str) -> None:
    """Ignore a progress sentence."""


def test_only_recordings_and_logs_are_fetched_and_all_is_removed(there: Path, out: Path) -> None:
    (out / "r2").mkdir()
    (out / "r2" / "r2.mcap").write_bytes(b"r")  # is here already
    assert fetch(out, "", quiet) == FetchedFiles(3, sum(map(len, FILES.values())) - 1)
    found = {path.relative_to(out).as_posix(): path.read_bytes() for path in out.glob("*/*")}
    assert found == FILES
    assert not there.exists()
    assert fetch(out, "", quiet) == FetchedFiles(0, 0)


def test_a_missing_recording_is_named(there: Path, out: Path) -> None:
    (there / "run" / "r1" / "r1.mcap").unlink()
    with pytest.raises(AcrcError, match=r"host h no longer has r1/r1.mcap, and there is no copy here"):
        fetch(out, "", quiet)
    assert (there / "run" / "r2" / "r2.mcap").is_file()  # nothing is removed
    fetching.remove_folder(str(there), RUN)
    with pytest.raises(AcrcError, match=r"host h no longer has r1/r1.mcap, and there is no copy here"):
        fetch(out, "", quiet)


def test_more_files_than_are_fetched_are_not_removed(
    there: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fetching, "MAX_FILES", 3)
    with pytest.raises(AcrcError, match="has 4 recordings and logs; at most 3 are fetched"):
        fetch(out, "", quiet)
    assert there.exists()


def test_a_worker_serves_recordings_and_logs_of_its_run_only(there: Path, tmp_path: Path) -> None:
    for folder in ("/etc", "acrc-y/../../acrc-x"):
        for ask in (fetching.list_files, fetching.remove_folder):
            with pytest.raises(AcrcError, match="is not a run's folder"):
                ask(str(tmp_path / folder), RUN)
    for name in ("r1/setup.json", "r1/../../x", ".router/passwords"):
        with pytest.raises(AcrcError, match="is not a recording"):
            fetching.read_piece(str(there), RUN, name, 0)
    with pytest.raises(AcrcError, match="belongs to another run"):
        fetching.remove_folder(str(there), "fedcba9876543210")
    (tmp_path / "acrc-link").symlink_to(there)
    fetching.remove_folder(str(tmp_path / "acrc-link"), RUN)
    assert there.exists()
    (there / "run" / "r1" / "r1.2.mcap").symlink_to("/etc/passwd")
    with pytest.raises(OSError):
        fetching.read_piece(str(there), RUN, "r1/r1.2.mcap", 0)


SUM = hashlib.sha256(FILES["r1/r1.mcap"]).hexdigest()
LIES: list[tuple[Any, str]] = [
    (b"[", "an invalid list of files"),
    ([HostFile("r3/r3.mcap", 1, SUM)], "'r3/r3.mcap', which is not its own"),
    ([HostFile("r2/r2.mcap", 1 << 60, SUM)], "an invalid list of files: Expected `int` <= "),
    ([HostFile("r2/r2.mcap", 1, "0")], "an invalid list of files: Expected `str` matching"),
    ([HostFile("r1/r1.mcap", 1, SUM)], "a different r1/r1.mcap than at the run's end"),
]


@pytest.mark.parametrize(("lie", "said"), LIES)
def test_invalid_lists_are_refused(out: Path, monkeypatch: pytest.MonkeyPatch, lie: Any, said: str) -> None:
    answers(monkeypatch, lambda function, *words: msgspec.json.encode(lie) if isinstance(lie, list) else lie)
    with pytest.raises(AcrcError) as caught:
        fetch(out, "", quiet)
    assert said in str(caught.value)
    assert [path.name for path in out.iterdir()] == [seal.HOSTS_FILE]


@pytest.mark.parametrize("lie", [b"", b"x" * (5 << 20), 3])
def test_an_invalid_part_is_refused_and_the_existing_file_kept(
    there: Path, out: Path, monkeypatch: pytest.MonkeyPatch, lie: Any
) -> None:
    (out / "r1").mkdir()
    (out / "r1" / "r1.mcap").write_bytes(b"begun")
    answers(
        monkeypatch,
        lambda f, *words: lie if f is fetching.read_piece and "r1.mcap" in words[2] else f(*words),
    )
    with pytest.raises(AcrcError, match=r"host h has sent"):
        fetch(out, "", quiet)
    assert (out / "r1" / "r1.mcap").read_bytes() == b"begun"
    assert there.exists()


def test_a_dead_or_missing_worker_is_named(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def dies(*words: Any) -> None:
        raise RuntimeError("the worker is gone")

    answers(monkeypatch, dies)
    with pytest.raises(AcrcError, match=r"--on tls://10.0.0.1:8786: host h: the worker is gone"):
        fetch(out, "", quiet)
    monkeypatch.setattr(fetching, "host_workers", lambda client: ["tls://10.0.0.9:4000"])
    with pytest.raises(AcrcError, match=r"--on tls://new:1: has no worker at 10.0.0.2, where host h has"):
        fetch(out, "tls://new:1", quiet)


def test_a_folder_without_hosts_and_a_damaged_list_are_named(out: Path) -> None:
    (out / seal.HOSTS_FILE).write_text('{"cluster": 3}')
    with pytest.raises(
        AcrcError, match=r"hosts.json: invalid list of a run's hosts: cluster is 3, but must be"
    ):
        fetch(out, "", quiet)
    (out / seal.HOSTS_FILE).unlink()
    with pytest.raises(AcrcError, match=r"not a run on several computers: no hosts\.json"):
        fetch(out, "", quiet)
