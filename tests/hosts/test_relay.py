"""What a relay does to a connection: delay, stall, refuse, cut; and how little else."""

import hashlib
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from benchmarks.hosts.delayed import MOST
from benchmarks.hosts.host import HERE
from benchmarks.hosts.namespaces import Hosts
from benchmarks.hosts.relay import main
from benchmarks.hosts.relay_process import RelayError, RelayProcess
from tests.hosts.on_host import connected_from, listening_on, python_on

SERVER = (HERE, 5000)
ANSWER = """
import socket, time
with socket.create_server(("10.77.0.1", 5001)) as listener:
    print("listens", flush=True)
    one = listener.accept()[0]
    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    while one.recv(1):
        one.sendall(b"%20d" % time.monotonic_ns())
"""
ASK = """
import socket, sys, time
one = socket.create_connection(("10.77.1.1", int(sys.argv[1])))
one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
limit, least, ways = float(sys.argv[2]), [1e9, 1e9], 0
while ways < 50 or (max(least) > limit and ways < 1000):
    begin = time.monotonic_ns()
    one.sendall(b"x")
    there = int(one.recv(20, socket.MSG_WAITALL))
    back = time.monotonic_ns()
    least = [min(least[0], (there - begin) / 1e6), min(least[1], (back - there) / 1e6)]
    ways += 1
    time.sleep(0.001)
print(*least)
"""
"""The shortest way there and the shortest way back, ms. What else is on the processor lengthens most of them,
so it goes on until one of each is within the limit."""


@pytest.fixture
def relay(hosts: Hosts) -> Iterator[RelayProcess]:
    with RelayProcess(hosts.here, f"{hosts.each[0].here_address}:0", f"{HERE}:{SERVER[1]}") as made:
        yield made


@pytest.fixture
def listener(hosts: Hosts) -> Iterator[socket.socket]:
    with listening_on(hosts.here, SERVER) as made:
        yield made


def port(relay: RelayProcess) -> int:
    return int(relay.address.rpartition(":")[2])


def exactly(one: socket.socket, count: int) -> bytes:
    """So many bytes, or what comes before the end."""
    found = b""
    while len(found) < count and (part := one.recv(count - len(found))):
        found += part
    return found


class Pair:
    """Both ends of a connection through the relay."""

    def __init__(self, hosts: Hosts, relay: RelayProcess, listener: socket.socket) -> None:
        first = hosts.each[0]
        self.client = connected_from(first, (first.here_address, port(relay)))
        self.server = listener.accept()[0]
        self.server.settimeout(self.client.gettimeout())

    def talks(self) -> bool:
        for one, other in ((self.client, self.server), (self.server, self.client)):
            one.sendall(b"?")
            if other.recv(1) != b"?":
                return False
        return True

    def close(self) -> None:
        self.client.close()
        self.server.close()


@pytest.mark.parametrize(("delay", "late"), [(0.5, 0.2), (1.0, 0.2), (10.0, 0.4)])
def test_each_way_takes_the_delay_and_hardly_more(hosts: Hosts, delay: float, late: float) -> None:
    words = hosts.here.command([sys.executable, "-c", ANSWER])
    with subprocess.Popen(words, stdout=subprocess.PIPE) as server:
        assert server.stdout is not None and server.stdout.readline() == b"listens\n"
        listen = f"{hosts.each[0].here_address}:0"
        with RelayProcess(hosts.here, listen, f"{HERE}:5001", delay_ms=delay) as made:
            ways = python_on(hosts.each[0], ASK, str(port(made)), str(delay + late)).split()
    assert len(ways) == 2
    for way in map(float, ways):
        assert delay <= way <= delay + late


def test_another_delay_is_for_what_is_sent_from_then_on(
    hosts: Hosts, relay: RelayProcess, listener: socket.socket
) -> None:
    pair = Pair(hosts, relay, listener)
    relay.tell("delay 800")
    begin = time.monotonic()
    pair.client.sendall(b"a")
    time.sleep(0.4)  # within which the relay takes it
    relay.tell("delay 0")
    pair.client.sendall(b"b")
    assert exactly(pair.server, 2) == b"ab"
    assert time.monotonic() - begin >= 0.8  # nothing overtakes
    begin = time.monotonic()
    assert pair.talks()
    assert time.monotonic() - begin < 0.8
    pair.close()


def test_a_delay_costs_no_throughput_and_every_byte_arrives_in_its_order(
    hosts: Hosts, relay: RelayProcess, listener: socket.socket
) -> None:
    relay.tell("delay 10")
    pair = Pair(hosts, relay, listener)
    data = b"".join(number.to_bytes(4, "big") for number in range(1 << 20))
    receive = (
        "import hashlib, socket, sys\n"
        "one, seen = socket.socket(fileno=int(sys.argv[1])), hashlib.sha256()\n"
        "while part := one.recv(1 << 20): seen.update(part)\n"
        "one.sendall(seen.hexdigest().encode())\n"
    )
    pair.server.settimeout(None)
    number = pair.server.fileno()
    with subprocess.Popen([sys.executable, "-c", receive, str(number)], pass_fds=[number]):
        pair.server.close()
        begin = time.monotonic()
        for _ in range(16):
            pair.client.sendall(data)
        pair.client.shutdown(socket.SHUT_WR)
        assert exactly(pair.client, 64).decode() == hashlib.sha256(data * 16).hexdigest()
        took = time.monotonic() - begin
    assert pair.client.recv(1) == b""  # and the end as well
    assert 16 * len(data) / took > 50e6
    pair.close()


def test_a_sender_waits_for_a_receiver_that_does_not_read(
    hosts: Hosts, relay: RelayProcess, listener: socket.socket
) -> None:
    pair = Pair(hosts, relay, listener)
    pair.client.settimeout(0.5)
    sent, part = 0, bytes(1 << 20)
    with suppress(TimeoutError):
        while sent < 4 * MOST:
            sent += pair.client.send(part)
    assert sent < 2 * MOST
    (own,) = (
        pid for pid in hosts.here.processes() if b"hosts.relay" in Path(f"/proc/{pid}/cmdline").read_bytes()
    )
    found = re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{own}/status").read_text())
    assert found is not None and int(found[1]) << 10 < 3 * MOST
    pair.close()


def test_nothing_passes_a_stalled_relay_and_nothing_is_lost(
    hosts: Hosts, relay: RelayProcess, listener: socket.socket
) -> None:
    pair = Pair(hosts, relay, listener)
    relay.tell("stall")
    first = hosts.each[0]
    new = connected_from(first, (first.here_address, port(relay)))  # as far as the relay
    pair.client.sendall(b"there")
    pair.server.sendall(b"back")
    for one in (pair.client, pair.server, listener):
        one.settimeout(0.2)
    for waits in (lambda: pair.client.recv(9), lambda: pair.server.recv(9), listener.accept):
        with pytest.raises(TimeoutError):
            waits()
    relay.tell("go")
    for one in (pair.client, pair.server, listener):
        one.settimeout(10.0)
    assert exactly(pair.server, 5) == b"there" and exactly(pair.client, 4) == b"back"
    listener.accept()[0].close()
    assert new.recv(1) == b""
    new.close()
    pair.close()


def test_a_cut_resets_both_ends_of_all_and_a_new_connection_is_made(
    hosts: Hosts, relay: RelayProcess, listener: socket.socket
) -> None:
    pairs = [Pair(hosts, relay, listener) for _ in range(3)]
    assert all(pair.talks() for pair in pairs)
    relay.tell("cut")
    for pair in pairs:
        for end in (pair.client, pair.server):
            with pytest.raises(ConnectionResetError):
                end.recv(1)
        pair.close()
    again = Pair(hosts, relay, listener)
    assert again.talks()
    again.close()


def test_who_is_refused_leaves_the_others_alone(
    hosts: Hosts, relay: RelayProcess, listener: socket.socket
) -> None:
    pair = Pair(hosts, relay, listener)
    relay.tell("refuse")
    with pytest.raises(ConnectionRefusedError):
        connected_from(hosts.each[0], (hosts.each[0].here_address, port(relay)))
    assert pair.talks()
    relay.tell("go")
    again = Pair(hosts, relay, listener)
    assert again.talks()
    again.close()
    pair.close()


def test_a_target_that_is_not_there_resets_the_client(hosts: Hosts, relay: RelayProcess) -> None:
    first = hosts.each[0]
    with (
        pytest.raises(ConnectionResetError),
        connected_from(first, (first.here_address, port(relay))) as client,
    ):
        client.recv(1)


def test_a_wrong_order_or_address_is_one_sentence(
    hosts: Hosts, relay: RelayProcess, capfd: pytest.CaptureFixture[str]
) -> None:
    name = f"relay on here, {hosts.each[0].here_address}:0 to {HERE}:5000: "
    for order, sentence in (
        ("faster", "order: 'faster'; must be delay MS, stall, refuse, cut or go"),
        ("delay", "order: 'delay'; must be delay MS, stall, refuse, cut or go"),
        ("delay -1", "delay: -1; must be 0 to 60000 ms"),
        ("delay nan", "delay: nan; must be 0 to 60000 ms"),
    ):
        with pytest.raises(RelayError) as caught:
            relay.tell(order)
        assert str(caught.value) == name + sentence
    relay.tell("go")  # it goes on
    with pytest.raises(RelayError) as caught, RelayProcess(hosts.here, relay.address, f"{HERE}:1"):
        pass
    assert str(caught.value).endswith(f": cannot listen at {relay.address}: Address already in use")
    for words, sentence in (
        (["nowhere:1", "10.77.0.1:1"], "address: nowhere:1; must be HOST:PORT, such as 10.77.0.1:8786"),
        (["10.77.0.1:1", "10.77.0.1:x"], "address: 10.77.0.1:x; must be HOST:PORT, such as 10.77.0.1:8786"),
        (["10.77.0.1:1", "10.77.0.1:1", "--delay-ms", "x"], "delay: x; must be 0 to 60000 ms"),
    ):
        assert main(words) == 2
        assert capfd.readouterr() == ("", f"{sentence}\n")
