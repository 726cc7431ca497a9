"""How busy a host is said to be, from what it tells once a second."""

from pathlib import Path

import msgspec
import pytest

from actors.installation.usage import typed
from actors.runtime.errors import AcrcError
from deploy.hosts import load_meter
from deploy.hosts.host_messages import Glimpse
from deploy.hosts.load_meter import LoadMeter
from observation.results import hosts_file
from observation.results.hosts_file import HostLoad, HostPart, HostsFile, LeftFile


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(load_meter, "time", made)
    return made


def process(pid: int, cpu_s: float, queued_s: float | None) -> Glimpse:
    return Glimpse(pid, 1, pid, "S", cpu_s, queued_s)


def test_the_load_is_what_processes_did_between_two_answers(clock: Clock) -> None:
    meter = LoadMeter()
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


def test_nothing_is_said_of_a_host_that_has_told_nothing() -> None:
    assert LoadMeter().load == HostLoad()


def test_a_run_says_what_is_elsewhere_until_it_is_here(tmp_path: Path) -> None:
    assert hosts_file.read(tmp_path) is None
    assert hosts_file.elsewhere(tmp_path) == {}
    part = HostPart("10.0.0.2", 2, ("r1", "r2"), "/tmp/acrc-x")
    left = {f"r{n}/r{n}.mcap": LeftFile(f"h{n % 2}", 1, "0" * 64) for n in (1, 2, 3)}
    told = HostsFile("tls://10.0.0.1:8786", "0", {"h0": part}, left)
    hosts_file.write(tmp_path, told)
    assert hosts_file.read(tmp_path) == told
    assert hosts_file.where(tmp_path, hosts_file.elsewhere(tmp_path)) == (
        f"{tmp_path}/r1/r1.mcap and 2 more are still on hosts h0, h1; "
        f"`{typed('cluster', 'fetch', tmp_path)}` brings what has stayed there"
    )
    for number in (1, 2):
        (tmp_path / f"r{number}").mkdir()
        (tmp_path / f"r{number}" / f"r{number}.mcap").touch()
    assert "r3/r3.mcap is still on host h1;" in hosts_file.where(tmp_path, hosts_file.elsewhere(tmp_path))
    for damage in (
        b"[]",
        msgspec.json.encode(told).replace(b"r3/r3", b"../r3"),
        b'{"cluster": "\\u001b[2J"}',
    ):
        (tmp_path / hosts_file.NAME).write_bytes(damage)
        with pytest.raises(AcrcError, match=r"hosts\.json: no list of a run's hosts"):
            hosts_file.elsewhere(tmp_path)
