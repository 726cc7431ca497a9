"""Hosts see "here" and not one another, and leave nothing behind."""

import errno
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from actors.runtime.lifecycle import process_table
from benchmarks.hosts.host import HERE, RigHost
from benchmarks.hosts.links import HostsError, lay_links
from benchmarks.hosts.namespaces import Hosts
from benchmarks.hosts.relay_process import RelayProcess
from tests.hosts.conftest import DISK
from tests.hosts.on_host import (
    KINDS,
    PATIENCE,
    alive_in,
    connected_from,
    eventually,
    listening_on,
    python_on,
    socket_on,
)

FAMILY = "import subprocess, time; subprocess.Popen(['setsid', 'sleep', '600']); time.sleep(600)"
"""A program whose child leaves its session."""
MAKER = """
import subprocess, sys, time
from benchmarks.hosts.namespaces import Hosts
with Hosts(1, disk_bytes=1 << 20) as hosts:
    subprocess.Popen(hosts.each[0].command(["sleep", "600"]))
    while not hosts.each[0].processes():
        time.sleep(0.01)
    every = (hosts.here, *hosts.each)
    print(hosts.each[0].disk, *(host.holder for host in every), flush=True)
    time.sleep(600)
"""


Rooms = Callable[[list[int]], set[str]]


@pytest.fixture
def rooms() -> Iterator[Rooms]:
    """The namespaces of holders; kept to the test's end, lest a robot's sandbox gets their numbers."""
    with ExitStack() as kept:

        def of(holders: list[int]) -> set[str]:
            paths = [Path(f"/proc/{pid}/ns/{kind}") for pid in holders for kind in KINDS]
            for path in paths:
                kept.enter_context(path.open("rb"))
            return {str(path.readlink()) for path in paths}

        yield of


def links() -> str:
    """The machine's own links and addresses."""
    return subprocess.run(["ip", "-o", "-br", "address"], capture_output=True, text=True, check=True).stdout


def failure(host: RigHost, address: tuple[str, int]) -> int:
    with socket_on(host) as one:
        return one.connect_ex(address)


def begun(host: RigHost, code: str = FAMILY) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(host.command([sys.executable, "-c", code]))
    assert eventually(lambda: len(host.processes()) == 2)
    return process


def test_a_host_reaches_another_one_through_here_only(hosts: Hosts) -> None:
    first, second = hosts.each
    with listening_on(second, (second.address, 5000)) as listener:
        assert failure(first, (second.address, 5000)) == errno.ENETUNREACH
        with connected_from(hosts.here, (second.address, 5000)), listener.accept()[0]:
            pass
        listen = f"{first.here_address}:0"
        with RelayProcess(hosts.here, listen, f"{second.address}:5000") as relay:
            port = int(relay.address.rpartition(":")[2])
            with connected_from(first, (first.here_address, port)) as one, listener.accept()[0] as other:
                one.sendall(b"from h1")
                assert other.recv(100) == b"from h1"


def test_every_host_reaches_here_at_one_address_and_is_known_by_its_own(hosts: Hosts) -> None:
    with listening_on(hosts.here, (HERE, 5000)) as listener:
        for host in hosts.each:
            with connected_from(host, (HERE, 5000)):
                accepted, (address, _) = listener.accept()
                accepted.close()
                assert address == host.address


def test_the_machine_and_its_network_are_out_of_reach_and_unchanged(hosts: Hosts) -> None:
    before = links()
    with socket.create_server(("127.0.0.1", 0)) as listener, Hosts(1) as more:
        for host in (hosts.here, *hosts.each, more.here, *more.each):
            assert failure(host, listener.getsockname()) == errno.ECONNREFUSED
            with socket_on(host, socket.SOCK_DGRAM) as one:  # which asks for the way, and sends nothing
                assert one.connect_ex(("198.51.100.1", 9)) == errno.ENETUNREACH
        assert links() == before
    assert "10.77." not in before


def test_links_are_never_laid_in_the_makers_own_network(hosts: Hosts) -> None:
    before, own = links(), os.getpid()
    for here, other in ((own, hosts.here.holder), (hosts.here.holder, own)):
        with pytest.raises(HostsError) as caught:
            lay_links(here, [other])
        assert str(caught.value) == f"process {own} has no network of its own; must have one to hold a host"
    assert links() == before


def test_a_host_has_its_own_name_and_disk_and_the_callers_folder(hosts: Hosts, tmp_path: Path) -> None:
    code = "import os, socket, tempfile; print(socket.gethostname(), os.getcwd(), tempfile.gettempdir())"
    for host, name in zip((hosts.here, *hosts.each), ("here", "h1", "h2"), strict=True):
        done = subprocess.run(
            host.command([sys.executable, "-c", code]),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.split() == [name, str(tmp_path), str(host.disk or tempfile.gettempdir())]
    fill = (
        "import sys\n"
        "with open(sys.argv[1], 'wb', buffering=0) as file:\n"
        "    for _ in range(int(sys.argv[2])): file.write(bytes(1 << 16))\n"
    )
    first, second = hosts.each
    with pytest.raises(subprocess.CalledProcessError) as caught:
        python_on(first, fill, f"{first.disk}/full", str(2 * DISK >> 16))
    assert "No space left on device" in caught.value.stderr
    look = "import os, sys; print(os.listdir(sys.argv[1]))"
    assert python_on(first, look, str(first.disk)) == "['full']"
    assert python_on(second, look, str(second.disk)) == "[]"
    python_on(first, "import os, sys; os.remove(sys.argv[1])", f"{first.disk}/full")


def test_a_signal_to_a_host_is_one_to_all_its_processes_and_to_no_other(hosts: Hosts) -> None:
    def states(host: RigHost) -> set[str]:
        seen = (process_table.glance(pid) for pid in host.processes())
        return {"T" if one.stopped else "runs" for one in seen if one is not None}

    first, second = hosts.each
    processes = [begun(host) for host in hosts.each]
    assert processes[0].pid in first.processes() and processes[0].pid not in second.processes()
    first.signal(signal.SIGSTOP)
    assert eventually(lambda: states(first) == {"T"}) and states(second) == {"runs"}
    first.signal(signal.SIGCONT)
    assert eventually(lambda: states(first) == {"runs"})
    first.signal(signal.SIGKILL)
    assert processes[0].wait(PATIENCE) == -signal.SIGKILL
    assert eventually(lambda: not first.processes()) and len(second.processes()) == 2
    second.signal(signal.SIGKILL)
    assert processes[1].wait(PATIENCE) == -signal.SIGKILL


def test_nothing_is_left_behind_also_after_an_exception(rooms: Rooms) -> None:
    before = links()
    with pytest.raises(ZeroDivisionError), Hosts(2, disk_bytes=1 << 20) as made:
        every = (made.here, *made.each)
        there = rooms([host.holder for host in every])
        process = begun(made.each[0])
        assert len(there) == 9 and len(set(alive_in(there))) == 5
        disk = Path(str(made.each[0].disk))
        assert disk.is_dir()
        raise ZeroDivisionError
    assert process.wait(PATIENCE) == -signal.SIGKILL
    assert alive_in(there) == []
    assert not disk.exists() and links() == before
    mounts = Path("/proc/self/mountinfo").read_text()
    assert not any(one in mounts for one in (*there, str(disk)))
    assert made.each[0].processes() == []


def test_hosts_end_with_a_maker_that_is_killed(rooms: Rooms) -> None:
    with subprocess.Popen([sys.executable, "-c", MAKER], stdout=subprocess.PIPE, text=True) as maker:
        assert maker.stdout is not None
        disk, *holders = maker.stdout.readline().split()
        there = rooms([int(pid) for pid in holders])
        assert len(set(alive_in(there))) == 3 and Path(disk).is_dir()
        maker.kill()
    assert eventually(lambda: alive_in(there) == [])
    assert not Path(disk).exists()


def test_who_is_on_a_host_that_has_lost_its_holder_is_told(
    rooms: Rooms, capfd: pytest.CaptureFixture[str]
) -> None:
    with subprocess.Popen([sys.executable, "-c", MAKER], stdout=subprocess.PIPE, text=True) as maker:
        assert maker.stdout is not None
        disk, *told = maker.stdout.readline().split()
        holders = [int(pid) for pid in told]
        there = rooms(holders)
        (left,) = set(alive_in(there)) - set(holders)
        for pid in (*holders, maker.pid):
            os.kill(pid, signal.SIGKILL)
    try:
        assert eventually(lambda: alive_in(there) == [left] * 3)
        with Hosts(1):
            said = capfd.readouterr().err
        sentence = "acrc: left on a host by an earlier run that was killed: "
        assert f"{sentence}h1 of {maker.pid}: sleep 600 (pid {left})" in said.splitlines()
    finally:
        os.kill(left, signal.SIGKILL)
        Path(disk).rmdir()  # the holders could not
    assert eventually(lambda: alive_in(there) == [])


def test_where_hosts_cannot_be_made_one_sentence_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def sentence(count: int = 1, **more: int) -> str:
        with pytest.raises(HostsError) as caught, Hosts(count, **more):
            pass
        return str(caught.value)

    assert sentence(0) == "hosts: 0; must be 1 to 250"
    assert sentence(251) == "hosts: 251; must be 1 to 250"
    assert sentence(disk_bytes=-1) == "the size of a host's disk: -1; must be 0 bytes or more"
    with monkeypatch.context() as patch:
        patch.setenv("PATH", "/nowhere")
        assert sentence() == "the program ip is not installed; to install it: apt install iproute2"
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: 1000)
        assert sentence() == "hosts are network namespaces; user id 1000 must be 0 (root) to make them"
