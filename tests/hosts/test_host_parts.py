"""Parts of a run on several computers: allocation, limits of hosts' output, load, remote files."""

from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acrc_testbed.results import seal
from acrc_testbed.results.seal import HostLoad, HostPart, HostsFile, RemoteFile
from actors.installation.usage import OptionError, command_line
from actors.runtime.errors import AcrcError
from deploy.hosts import host_link
from deploy.hosts.address import bind_address, dask_address, free_port, parse_listen
from deploy.hosts.agent import HostEvents, HostOrders, HostReport, ProcessStatus
from deploy.hosts.allocation import HostOffer, distribute_robots, host_fault
from deploy.hosts.files import FilePart, FilePartError, GrowingFile, IncomingFiles, files_below, read_files
from deploy.hosts.host_link import HostLink, LoadMeter

HERE = "127.0.0.1"


@given(st.integers(0, 50), st.dictionaries(st.sampled_from("abcdef"), st.integers(1, 64), min_size=1))
def test_every_robot_is_on_one_host_and_no_core_has_two_more_than_another(
    count: int, cores: dict[str, int]
) -> None:
    robots = [f"r{number}" for number in range(count)]
    placed = distribute_robots(robots, cores)
    assert [robot for some in placed.values() for robot in some] == robots
    assert all(placed.values())
    loads = {host: len(placed.get(host, ())) for host in cores}
    for host, load in loads.items():
        if load:
            assert (load - 1) / cores[host] <= min(loads[other] / cores[other] for other in cores)


@pytest.mark.parametrize(
    "path", ["r1.mcap", "r2/r2.mcap", "../r1/x", "r1/../r2/x", "r1//x", "r1/./x", "/r1/x", "r1/a\0b", "r1/"]
)
def test_files_outside_the_robots_folders_are_refused(tmp_path: Path, path: str) -> None:
    incoming = IncomingFiles(tmp_path, {"r1"}.__contains__, 100, "")
    with pytest.raises(FilePartError):
        incoming.append(FilePart(path, b"x"))
    assert list(tmp_path.rglob("*")) == []


def test_nothing_is_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "run" / "r1").mkdir(parents=True)
    (tmp_path / "away").mkdir()
    (tmp_path / "run" / "r1" / "own").symlink_to(tmp_path / "away")
    incoming = IncomingFiles(tmp_path / "run", {"r1"}.__contains__, 100, "")
    with pytest.raises(FilePartError):
        incoming.append(FilePart("r1/own/x", b"x"))
    (tmp_path / "run" / "r1" / "r1.mcap").symlink_to(tmp_path / "away" / "y")
    with pytest.raises(OSError, match="symbolic"):
        incoming.append(FilePart("r1/r1.mcap", b"x"))
    assert list((tmp_path / "away").iterdir()) == []


def test_a_host_sends_no_more_than_its_robots_may_write(tmp_path: Path) -> None:
    incoming = IncomingFiles(tmp_path, {"r1"}.__contains__, 5, "disk_mb")
    incoming.append(FilePart("r1/a", b"xyz"))
    with pytest.raises(FilePartError):
        incoming.append(FilePart("r1/b", b"xyz"))
    assert (tmp_path / "r1" / "a").read_bytes() == b"xyz"


def test_files_arrive_as_they_are_also_while_they_grow(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "r1" / "own").mkdir(parents=True)
    there.mkdir()
    (here / "r1" / "own" / "note").write_bytes(bytes(range(256)) * 700)
    (here / "r1" / "own" / "empty").touch()
    (here / "r1" / "own" / "link").symlink_to("/etc/hostname")
    incoming = IncomingFiles(there, {"r1"}.__contains__, 1 << 20, "")
    growing = GrowingFile(here / "r1" / "log", "r1/log")
    assert growing.part() is None
    for piece in (b"first", b"", b"second"):
        with (here / "r1" / "log").open("ab") as log:
            log.write(piece)
        while (part := growing.part()) is not None:
            incoming.append(part)
    for part in read_files(files_below(here / "r1" / "own", here)):
        incoming.append(part)
    growing.close()
    assert {path.name: path.read_bytes() for path in there.rglob("*") if path.is_file()} == {
        "log": b"firstsecond",
        "note": bytes(range(256)) * 700,
        "empty": b"",
    }


OFFER = HostOffer("lab1", 8, "abc", {"python": "3.11.7"}, {"arrays": "1" * 64}, None, "/opt/acrc")


@pytest.mark.parametrize(
    ("there", "fault"),
    [
        (OFFER, None),
        (msgspec.structs.replace(OFFER, versions={"python": "3.11.7", "more": "1"}, cores=2), None),
        (msgspec.structs.replace(OFFER, commit="def"),
         "has def, this computer abc; update it: git -C /opt/acrc fetch && git -C /opt/acrc checkout "
         "abc, and restart its worker"),
        (msgspec.structs.replace(OFFER, versions={"python": "3.12.1"}),
         "has python 3.12.1, this computer 3.11.7; install the same version"),
        (msgspec.structs.replace(OFFER, kernels={"arrays": "2" * 64}),
         "computes different bits than this computer: in arrays"),
    ],
)  # fmt: skip
def test_unsuitable_hosts_are_refused_with_a_reason(there: HostOffer, fault: str | None) -> None:
    assert host_fault(there, OFFER) == fault


@pytest.mark.parametrize(
    ("word", "place"),
    [("10.0.0.5:7450", ("10.0.0.5", 7450)), ("lab", ("lab", 0)), ("[::1]:7450", ("::1", 7450))],
)
def test_hosts_connect_to_an_address_with_a_port_or_without(word: str, place: tuple[str, int]) -> None:
    assert parse_listen(word) == place


@pytest.mark.parametrize("word", ["", ":7450", "10.0.0.5:", "10.0.0.5:65536", "a b", "10.0.0.5:7450:1"])
def test_invalid_listen_addresses_are_refused(word: str) -> None:
    with pytest.raises(OptionError, match="must be an address of this computer"):
        parse_listen(word)


def test_addresses_are_bound_and_schemes_are_equal() -> None:
    assert bind_address(HERE) == HERE
    assert bind_address("203.0.113.7") == "0.0.0.0"  # documentation address, RFC 5737
    assert free_port(HERE, port := free_port(HERE)) == port
    with pytest.raises(AcrcError, match="--listen"):
        bind_address("no.such.host.invalid")
    assert dask_address("dask+tls://lab:8786") == dask_address("tls://lab:8786") == "tls://lab:8786"
    assert dask_address("dask://127.0.0.1:8786") == "tcp://127.0.0.1:8786"
    with pytest.raises(OptionError, match="must be tls://"):
        dask_address("dask://lab:8786")


class FakeHost:
    """Agent of a host, and its future, with prepared reports."""

    status = "finished"

    def __init__(self, *answers: object) -> None:
        self.answers = list(answers)
        self.put_parts: list[FilePart] = []
        self.closed = False

    def done(self) -> bool:
        return True

    def result(self) -> "FakeHost":
        return self

    def put(self, parts: list[FilePart]) -> SimpleNamespace:
        self.put_parts += parts
        return answered(None)

    def close(self) -> SimpleNamespace:
        self.closed = True
        return answered(None)

    def exchange(self, orders: HostOrders) -> SimpleNamespace:
        return answered(self.answers.pop(0))


def answered(answer: object) -> SimpleNamespace:
    def result() -> object:
        if isinstance(answer, Exception):
            raise answer
        return answer

    return SimpleNamespace(done=lambda: True, result=result)


REPORT = HostReport(
    clock_s=0.0, folder="/tmp/acrc-1", joined=True, is_link_lost=False, fault="", events=HostEvents(),
    process_list=None, done=False,
)  # fmt: skip


def packed(*, done: bool = False, **events: object) -> bytes:
    happened = msgspec.structs.replace(HostEvents(more=not done), **events)
    return msgspec.msgpack.encode(msgspec.structs.replace(REPORT, done=done, events=happened))


def link_to(host: FakeHost, folder: Path) -> HostLink:
    files = IncomingFiles(folder, {"r1"}.__contains__, 5, "the limit of its robots (disk_mb)")
    return HostLink("h1", 1, ("r1",), files, host)  # type: ignore[arg-type]


def test_files_are_sent_before_a_host_begins_and_its_folder_is_removed_at_the_end(tmp_path: Path) -> None:
    large, empty = tmp_path / "large", tmp_path / "empty"
    large.write_bytes(bytes(range(256)) * 8000)
    empty.touch()
    host = FakeHost(packed(), packed(files=[FilePart("r1/log", b"said")], done=True))
    link = link_to(host, tmp_path)
    link.begin([(large, "run/r1/large"), (empty, "code/1/empty")])
    for _ in range(8):
        link.poll()
    assert b"".join(part.data for part in host.put_parts if part.path == "run/r1/large") == large.read_bytes()
    assert host.put_parts[-1] == FilePart("code/1/empty", b"")
    assert (tmp_path / "r1" / "log").read_bytes() == b"said"
    assert link.joined and link.is_over and not link.lost and host.closed


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"\xc1", "it has sent an invalid report: "),
        (packed(refused={3: "x" * 3000}), "it has sent an invalid report: Expected `str` of length <= 2000"),
        (b"0" * ((1 << 23) + 1), "it has sent an answer that is not a report"),
        ("text", "it has sent an answer that is not a report"),
        (packed(ending=[7]), "it reports process 7, which was not requested"),
        (
            packed(files=[FilePart("r1/x", b"123456")]),
            "it has sent more than 5 B of files, the limit of its robots (disk_mb)",
        ),
        (packed(files=[FilePart("r2/x", b"1")]), "it has sent a file 'r2/x', which is not its own"),
        (OSError("Unable to contact Actor's worker"), "its worker has ended, or left the cluster"),
        (AcrcError("no space\x1b[2J"), "no space\\x1b[2J"),
    ],
)
def test_a_host_with_an_impossible_answer_is_lost(tmp_path: Path, answer: object, why: str) -> None:
    link = link_to(FakeHost(answer), tmp_path)
    link.poll()
    link.poll()
    assert link.lost.startswith(why)
    assert link.is_over
    assert list(tmp_path.iterdir()) == []


def process(pid: int, cpu_s: float, queued_s: float | None) -> ProcessStatus:
    return ProcessStatus(pid, 1, pid, "S", cpu_s, queued_s)


def test_the_load_is_measured_between_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now_s=100.0)
    clock.monotonic = lambda: clock.now_s
    monkeypatch.setattr(host_link, "time", clock)
    meter = LoadMeter()
    assert meter.load == HostLoad()
    meter.note_request()
    clock.now_s += 0.01
    meter.add_report([process(1, 5.0, 1.0), process(2, 7.0, None)])
    assert meter.load == HostLoad(0.0, 0.0, 0.01, 0.01)
    clock.now_s += 1.96
    meter.note_request()
    clock.now_s += 0.04
    meter.add_report([process(1, 6.0, 2.0), process(2, 8.0, 9.0), process(3, 50.0, 50.0)])
    assert meter.load == HostLoad(worked=1.0, waited=0.5, answer_s=0.025, slowest_s=0.04)
    clock.now_s += 2.0  # asked by nobody: another process has ended and its number is used again
    meter.add_report([process(1, 0.5, 0.5), process(2, 12.0, 9.0)])
    assert meter.load == HostLoad(worked=1.5, waited=0.25, answer_s=0.025, slowest_s=0.04)


def test_a_run_names_remote_files_until_they_are_fetched(tmp_path: Path) -> None:
    assert seal.read_hosts(tmp_path) is None
    assert seal.remote_recordings(tmp_path) == {}
    part = HostPart("10.0.0.2", 2, ("r1", "r2"), "/tmp/acrc-x")
    left = {f"r{n}/r{n}.mcap": RemoteFile(f"h{n % 2}", 1, "0" * 64) for n in (1, 2, 3)}
    told = HostsFile("tls://10.0.0.1:8786", "0", {"h0": part}, left)
    seal.write_hosts(tmp_path, told)
    assert seal.read_hosts(tmp_path) == told
    assert seal.fetch_sentence(tmp_path, seal.remote_recordings(tmp_path)) == (
        f"{tmp_path}/r1/r1.mcap and 2 more are still on hosts h0, h1; "
        f"fetch with `{command_line('cluster', 'fetch', tmp_path)}`"
    )
    for number in (1, 2):
        (tmp_path / f"r{number}").mkdir()
        (tmp_path / f"r{number}" / f"r{number}.mcap").touch()
    assert "r3/r3.mcap is still on host h1;" in seal.fetch_sentence(
        tmp_path, seal.remote_recordings(tmp_path)
    )
    for damage in (
        b"[]",
        msgspec.json.encode(told).replace(b"r3/r3", b"../r3"),
        b'{"cluster": "\\u001b[2J"}',
    ):
        (tmp_path / seal.HOSTS_FILE).write_bytes(damage)
        with pytest.raises(AcrcError, match=r"hosts\.json: invalid list of a run's hosts"):
            seal.remote_recordings(tmp_path)
