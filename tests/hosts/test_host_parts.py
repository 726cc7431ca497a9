"""What a run over several computers is made of: who is where, what a host may send, who is fit."""

import socket
import ssl
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acrc_testbed.results import seal
from acrc_testbed.results.seal import HostLoad, HostPart, HostsFile, LeftFile
from actors.installation.usage import OptionError, typed
from actors.runtime.errors import AcrcError
from deploy.clusters.address import plain
from deploy.hosts import certificates, channel, host_program
from deploy.hosts.channel import (
    LONGEST,
    AskPulse,
    Channel,
    ChannelClosedError,
    FilePart,
    FromHost,
    Glimpse,
    Joined,
    ToHost,
    bound,
    from_host,
    place_of,
    to_host,
)
from deploy.hosts.fetching import FilePartError, GrowingFile, Incoming, parts
from deploy.hosts.host_probe import HostOffer, unfit
from deploy.hosts.host_program import LoadMeter
from deploy.hosts.run_hosts import shares

HERE = "127.0.0.1"


@given(st.integers(0, 50), st.dictionaries(st.sampled_from("abcdef"), st.integers(1, 64), min_size=1))
def test_every_robot_is_on_one_host_and_no_core_has_two_more_than_another(
    count: int, cores: dict[str, int]
) -> None:
    robots = [f"r{number}" for number in range(count)]
    placed = shares(robots, cores)
    assert [robot for some in placed.values() for robot in some] == robots
    assert all(placed.values())
    loads = {host: len(placed.get(host, ())) for host in cores}
    for host, load in loads.items():
        if load:
            assert (load - 1) / cores[host] <= min(loads[other] / cores[other] for other in cores)


@pytest.mark.parametrize(
    "path",
    ["r1.mcap", "r2/r2.mcap", "../r1/x", "r1/../r2/x", "r1//x", "r1/./x", "/r1/x", "r1/a\0b", "r1/"],
)
def test_nothing_is_taken_beside_the_robots_own_folders(tmp_path: Path, path: str) -> None:
    incoming = Incoming(tmp_path, {"r1"}.__contains__, 100)
    with pytest.raises(FilePartError):
        incoming.take(FilePart(path, b"x"))
    assert list(tmp_path.rglob("*")) == []


def test_nothing_is_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "run" / "r1").mkdir(parents=True)
    (tmp_path / "away").mkdir()
    (tmp_path / "run" / "r1" / "own").symlink_to(tmp_path / "away")
    incoming = Incoming(tmp_path / "run", {"r1"}.__contains__, 100)
    with pytest.raises(FilePartError):
        incoming.take(FilePart("r1/own/x", b"x"))
    (tmp_path / "run" / "r1" / "r1.mcap").symlink_to(tmp_path / "away" / "y")
    with pytest.raises(OSError, match="symbolic"):
        incoming.take(FilePart("r1/r1.mcap", b"x"))
    assert list((tmp_path / "away").iterdir()) == []


def test_a_host_sends_no_more_than_its_robots_may_write(tmp_path: Path) -> None:
    incoming = Incoming(tmp_path, {"r1"}.__contains__, 5)
    incoming.take(FilePart("r1/a", b"xyz"))
    with pytest.raises(FilePartError):
        incoming.take(FilePart("r1/b", b"xyz"))
    assert (tmp_path / "r1" / "a").read_bytes() == b"xyz"


def test_files_arrive_as_they_are_also_while_they_grow(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    (here / "r1" / "own").mkdir(parents=True)
    there.mkdir()
    (here / "r1" / "own" / "note").write_bytes(bytes(range(256)) * 700)
    (here / "r1" / "own" / "empty").touch()
    (here / "r1" / "own" / "link").symlink_to("/etc/hostname")
    incoming = Incoming(there, {"r1"}.__contains__, 1 << 20)
    growing = GrowingFile(here, here / "r1" / "log")
    assert growing.part() is None
    for piece in (b"first", b"", b"second"):
        with (here / "r1" / "log").open("ab") as log:
            log.write(piece)
        while (part := growing.part()) is not None:
            incoming.take(part)
    for part in parts(here, here / "r1" / "own"):
        incoming.take(part)
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
         "has def, this is abc; must be the same: git -C /opt/acrc fetch && git -C /opt/acrc checkout "
         "abc, and start its worker anew"),
        (msgspec.structs.replace(OFFER, versions={"python": "3.12.1"}),
         "has python 3.12.1, this is 3.11.7; must be the same"),
        (msgspec.structs.replace(OFFER, kernels={"arrays": "2" * 64}),
         "computes otherwise than this computer: other bits come from arrays"),
    ],
)  # fmt: skip
def test_who_is_no_fit_host_is_told_why(there: HostOffer, fault: str | None) -> None:
    assert unfit(there, OFFER) == fault


@pytest.mark.parametrize(
    ("word", "place"),
    [("10.0.0.5:7450", ("10.0.0.5", 7450)), ("lab", ("lab", 0)), ("[::1]:7450", ("::1", 7450))],
)
def test_hosts_connect_to_an_address_with_a_port_or_without(word: str, place: tuple[str, int]) -> None:
    assert place_of(word) == place


@pytest.mark.parametrize("word", ["", ":7450", "10.0.0.5:", "10.0.0.5:65535", "a b", "10.0.0.5:7450:1"])
def test_what_is_none_is_refused(word: str) -> None:
    with pytest.raises(OptionError, match="must be an address of this computer"):
        place_of(word)


def test_addresses_are_bound_and_schemes_are_equal() -> None:
    assert bound(HERE) == HERE
    assert bound("203.0.113.7") == "0.0.0.0"  # kept for documentation (RFC 5737): nobody has it
    with pytest.raises(AcrcError, match="--listen"):
        bound("no.such.host.invalid")
    assert plain("dask+tls://lab:8786") == plain("tls://lab:8786") == "tls://lab:8786"
    assert plain("dask://127.0.0.1:8786") == "tcp://127.0.0.1:8786"
    with pytest.raises(OptionError, match="must be tls://"):
        plain("dask://lab:8786")


Ends = tuple[Channel[FromHost], Channel[ToHost], ssl.SSLSocket]


@pytest.fixture
def ends(tmp_path: Path) -> Iterator[Ends]:
    """The two ends of a channel; the host's socket as well."""
    keys = certificates.draw(["h1"], HERE)
    keys.world.write(tmp_path / "world")
    keys.hosts["h1"].write(tmp_path / "h1")
    with ExitStack() as stack:
        server = stack.enter_context(socket.create_server((HERE, 0)))
        plain_socket = stack.enter_context(socket.create_connection(server.getsockname()))
        ours, _ = server.accept()
        ours.setblocking(False)
        plain_socket.setblocking(False)
        one = channel.server_context(tmp_path / "world").wrap_socket(
            ours, server_side=True, do_handshake_on_connect=False
        )
        other = channel.client_context(tmp_path / "h1").wrap_socket(
            plain_socket, server_hostname=HERE, do_handshake_on_connect=False
        )
        waiting = [one, other]
        while waiting:
            for end in list(waiting):
                try:
                    end.do_handshake()
                    waiting.remove(end)
                except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                    continue
        assert channel.common_name(one) == "h1"
        stack.enter_context(one)
        stack.enter_context(other)
        yield to_host(one), from_host(other), other


def received(channel: Channel[FromHost], count: int) -> list[FromHost]:
    found: list[FromHost] = []
    for _ in range(1000):
        found += channel.receive()
        if len(found) >= count:
            break
    return found


def test_messages_come_whole_and_in_order_without_anybody_waiting(ends: Ends) -> None:
    here, there, _ = ends
    sent = [FilePart(f"r1/{number}", bytes([number % 256]) * 60_000) for number in range(200)]
    for part in sent:
        there.send(part)
    assert there.waiting > 0  # more than sockets hold: it waits here, and whoever sent it does not
    found: list[FromHost] = []
    while len(found) < len(sent):
        there.flush()
        found += here.receive()
    assert found == sent
    assert there.waiting == 0
    here.send(AskPulse())
    assert received(there, 1) == [AskPulse()]  # type: ignore[arg-type, comparison-overlap]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\x05\0\0\0hello", "something came that is no message"),
        ((LONGEST + 1).to_bytes(4, "little"), "was announced"),
        (b"", "the connection was closed"),
    ],
)
def test_what_is_no_message_ends_the_channel_behind_what_came(ends: Ends, data: bytes, words: str) -> None:
    here, there, bare = ends
    there.send(Joined(1.5, "/tmp/acrc-1"))
    if data:
        bare.send(data)
    else:
        bare.close()
    found: list[FromHost] = []
    with pytest.raises(ChannelClosedError, match=words):
        for _ in range(1000):
            for message in here.receive():
                found.append(message)
    assert found == [Joined(1.5, "/tmp/acrc-1")]


def process(pid: int, cpu_s: float, queued_s: float | None) -> Glimpse:
    return Glimpse(pid, 1, pid, "S", cpu_s, queued_s)


def test_the_load_is_what_processes_did_between_two_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now_s=100.0)
    clock.monotonic = lambda: clock.now_s
    monkeypatch.setattr(host_program, "time", clock)
    meter = LoadMeter()
    assert meter.load == HostLoad()
    meter.asked()
    clock.now_s += 0.01
    meter.answered([process(1, 5.0, 1.0), process(2, 7.0, None)])
    assert meter.load == HostLoad(0.0, 0.0, 0.01, 0.01)
    clock.now_s += 1.96
    meter.asked()
    clock.now_s += 0.02
    meter.asked()  # the first question is still open
    clock.now_s += 0.02
    meter.answered([process(1, 6.0, 2.0), process(2, 8.0, 9.0), process(3, 50.0, 50.0)])
    assert meter.load == HostLoad(worked=1.0, waited=0.5, answer_s=0.025, slowest_s=0.04)
    clock.now_s += 2.0  # asked by nobody: another process has ended and its number is used again
    meter.answered([process(1, 0.5, 0.5), process(2, 12.0, 9.0)])
    assert meter.load == HostLoad(worked=1.5, waited=0.25, answer_s=0.025, slowest_s=0.04)


def test_a_run_says_what_is_elsewhere_until_it_is_here(tmp_path: Path) -> None:
    assert seal.read(tmp_path) is None
    assert seal.elsewhere(tmp_path) == {}
    part = HostPart("10.0.0.2", 2, ("r1", "r2"), "/tmp/acrc-x")
    left = {f"r{n}/r{n}.mcap": LeftFile(f"h{n % 2}", 1, "0" * 64) for n in (1, 2, 3)}
    told = HostsFile("tls://10.0.0.1:8786", "0", {"h0": part}, left)
    seal.write(tmp_path, told)
    assert seal.read(tmp_path) == told
    assert seal.where(tmp_path, seal.elsewhere(tmp_path)) == (
        f"{tmp_path}/r1/r1.mcap and 2 more are still on hosts h0, h1; "
        f"`{typed('cluster', 'fetch', tmp_path)}` brings what has stayed there"
    )
    for number in (1, 2):
        (tmp_path / f"r{number}").mkdir()
        (tmp_path / f"r{number}" / f"r{number}.mcap").touch()
    assert "r3/r3.mcap is still on host h1;" in seal.where(tmp_path, seal.elsewhere(tmp_path))
    for damage in (
        b"[]",
        msgspec.json.encode(told).replace(b"r3/r3", b"../r3"),
        b'{"cluster": "\\u001b[2J"}',
    ):
        (tmp_path / seal.NAME).write_bytes(damage)
        with pytest.raises(AcrcError, match=r"hosts\.json: no list of a run's hosts"):
            seal.elsewhere(tmp_path)
