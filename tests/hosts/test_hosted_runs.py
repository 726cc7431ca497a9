"""A swarm over several computers: the digest of one, and what is said when one of them fails."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path

import pytest

from actors.runtime.errors import AcrcError
from benchmarks.hosts.between import LISTEN, relayed
from benchmarks.hosts.cluster import TlsCluster
from benchmarks.hosts.namespaces import Hosts
from observation.accounting.account import account
from observation.evidence.run_reader import RunReader
from observation.replay import recheck, record_check
from observation.results import hosts_file
from observation.results.seal import check_seal
from tests.hosts.hosted_runs import ROOT, HostedRun, digest_here

pytestmark = pytest.mark.timeout(400)
LONG = ("--robots", "4", "--duration", "3000", "--seed", "1", "--timeout", "5")


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    with Hosts(2, disk_bytes=24 << 20) as made:
        yield made


@pytest.fixture(scope="module")
def cluster(hosts: Hosts, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TlsCluster]:
    with TlsCluster(hosts, tmp_path_factory.mktemp("cluster") / "c") as made:
        yield made


def ended(hosts: Hosts, cluster: TlsCluster, out: Path, fail: Callable[[HostedRun], None]) -> tuple[int, str]:
    """How a long run ends once that has happened to it; the recordings can be read, nothing is left."""
    run = HostedRun(hosts, cluster, out, *LONG)
    run.under_way()
    fail(run)
    found = run.ended()
    with RunReader(out) as reader:
        assert reader.robots == ("r1", "r2", "r3", "r4")
    assert len(list(out.glob("r[0-9]/*.mcap"))) == 4
    assert run.nothing_left()
    return found


OWN = """
from cleaning.strategies.chapter import behaviour as chapter

def behaviour(start):
    print("here I am")
    return chapter(start)
"""


def test_code_of_ones_own_goes_along_and_what_it_prints_and_records_comes_back(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "mine.py").write_text(OWN)
    words = ("--robots", "3", "--duration", "2", "--json", "--strategy", "mine:behaviour")
    code = ("--modules", str(tmp_path / "code"))
    run = HostedRun(hosts, cluster, tmp_path / "hosted", *words, *code, "--log", "*", "--check")
    out, said = run.process.communicate(timeout=180)
    assert run.process.returncode == 0, said
    for robot in ("r1", "r2", "r3"):
        assert f"{robot}       0.000 s  step 0  here I am" in said
    assert "checked: 5 actors replayed" in said
    assert json.loads(out)["digest"] == digest_here(tmp_path / "here", *words, *code)


@pytest.mark.parametrize(
    ("delay_ms", "stall_s"), [(10.0, 6), pytest.param(1.0, 60, marks=pytest.mark.nightly)]
)
def test_links_that_are_late_and_stall_change_nothing_and_are_told(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path, delay_ms: float, stall_s: int
) -> None:
    words = ("--robots", "3", "--duration", "20", "--json")
    with relayed(hosts, delay_ms) as relays:
        run = HostedRun(hosts, cluster, tmp_path / "hosted", *words, *LISTEN)
        run.under_way()
        for order in ("stall", "go"):
            for relay in chain.from_iterable(relays.values()):
                relay.tell(order)
            time.sleep(stall_s if order == "stall" else 0)
        out, said = run.process.communicate(timeout=180)
    assert run.process.returncode == 0, said
    assert json.loads(out)["digest"] == digest_here(tmp_path / "here", *words)
    assert "nothing has been heard of host h1 for 5 s; the run waits for it" in said
    assert "host h1 is heard again" in said
    assert "hosts, on average: h1 worked with " in said


def acrc(hosts: Hosts, cluster: TlsCluster, *words: str) -> subprocess.CompletedProcess[str]:
    """One more command where the run was typed."""
    command = hosts.here.command([sys.executable, "-P", "-m", "command_line", *words])
    return subprocess.run(
        command, cwd=ROOT, env=cluster.environment, capture_output=True, text=True, check=False, timeout=180
    )


def test_recordings_that_are_left_are_sealed_looked_at_from_here_and_fetched(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    words, out = ("--robots", "4", "--duration", "8", "--json"), tmp_path / "hosted"
    run = HostedRun(hosts, cluster, out, *words, "--leave")
    printed, said = run.process.communicate(timeout=180)
    assert run.process.returncode == 0, said
    result = json.loads(printed)
    assert result["digest"] == digest_here(tmp_path / "here", *words)
    assert result["deeco"] == json.loads((tmp_path / "here" / "run.json").read_text())["deeco"]
    assert list(out.glob("r[0-9]/*.mcap")) == []
    assert f"{out}/r1/r1.mcap and 3 more are still on hosts h1, h2; `" in said
    assert len(run.folders_left()) == 2
    assert run.secrets_left() == []
    told = hosts_file.read(out)
    assert told is not None
    assert {name: part.robots for name, part in told.hosts.items()} == {
        "h1": ("r1", "r2"),
        "h2": ("r3", "r4"),
    }
    assert all(0 < part.load.answer_s <= part.load.slowest_s for part in told.hosts.values())
    for wants_robots in (account, record_check.check, check_seal, recheck.recheck):
        with pytest.raises(AcrcError, match=r"still on hosts h1, h2; `\S+ cluster fetch"):
            wants_robots(out)
    drawn = acrc(hosts, cluster, "view", str(out), "--png")
    assert drawn.returncode == 0, drawn.stderr
    assert "until then it is drawn as seen from outside" in drawn.stderr
    fetched = acrc(hosts, cluster, "cluster", "fetch", str(out), "--json")
    assert fetched.returncode == 0, fetched.stderr
    assert json.loads(fetched.stdout)["files"] == 4
    assert run.folders_left() == []
    assert record_check.check(out).digest == result["digest"]
    assert check_seal(out) is not None
    again = acrc(hosts, cluster, "cluster", "fetch", str(out))
    assert (again.returncode, again.stdout) == (0, "0 files have come, 0 B\n"), again.stderr


def test_a_link_that_is_cut_ends_the_run_with_the_name_of_its_host(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    with relayed(hosts, 0.0) as relays:
        run = HostedRun(hosts, cluster, tmp_path / "out", *LONG, *LISTEN)
        run.under_way()
        for relay in relays["h2"]:
            relay.tell("cut")
        code, said = run.ended()
    assert code == 1
    assert said.startswith("acrc: host h2 is lost, with r3, r4: the connection ")
    assert "; what robots have recorded is in " in said
    assert run.nothing_left()
    assert len(run.folders_left()) == 1
    assert run.secrets_left() == []
    fetched = acrc(hosts, cluster, "cluster", "fetch", str(tmp_path / "out"))
    assert fetched.returncode == 0, fetched.stderr
    assert run.folders_left() == []
    with RunReader(tmp_path / "out") as reader:
        assert reader.robots == ("r1", "r2", "r3", "r4")


def test_a_worker_that_is_killed_ends_the_run_with_its_name(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    code, said = ended(hosts, cluster, tmp_path / "out", lambda run: cluster.kill_worker(0))
    cluster.start_worker(0)
    assert code == 1
    assert said.startswith("acrc: host h1 is lost, with r1, r2: the connection ")


def test_a_stopped_host_ends_the_run_with_its_name(hosts: Hosts, cluster: TlsCluster, tmp_path: Path) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", *LONG)
    run.under_way()
    hosts.each[1].signal(signal.SIGSTOP)
    try:
        code, said = run.ended()
    finally:
        hosts.each[1].signal(signal.SIGCONT)
    assert code == 1
    assert said.startswith("acrc: host h2 is lost, with r3, r4: nothing has been heard of it for 20 s")
    assert run.nothing_left()


def test_ctrl_c_ends_everything_everywhere(hosts: Hosts, cluster: TlsCluster, tmp_path: Path) -> None:
    code, _ = ended(hosts, cluster, tmp_path / "out", lambda run: run.process.send_signal(signal.SIGINT))
    assert code == 130


def test_a_full_disk_on_a_host_is_told_with_its_name(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    def fill(run: HostedRun) -> None:
        disk = hosts.each[1].disk
        words = ["sh", "-c", f"head -c 30M /dev/zero > {disk}/full; true"]
        subprocess.run(hosts.each[1].command(words), check=True, capture_output=True)

    try:
        code, said = ended(hosts, cluster, tmp_path / "out", fill)
    finally:
        full = ["sh", "-c", f"rm -f {hosts.each[1].disk}/full"]
        subprocess.run(hosts.each[1].command(full), check=True)
    assert code == 1
    assert "(on host h2)" in said
    assert "no space left on device" in said


def test_an_order_and_a_log_reach_robots_on_hosts(hosts: Hosts, cluster: TlsCluster, tmp_path: Path) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", *LONG)
    run.under_way()
    order = [sys.executable, "-P", "-m", "command_line", "order", str(run.out), "kill", "r3"]
    assert subprocess.run(order, cwd=ROOT, capture_output=True, text=True, check=False).returncode == 0
    order[-2:] = ["stop"]
    assert subprocess.run(order, cwd=ROOT, capture_output=True, text=True, check=False).returncode == 0
    code, said = run.ended()
    assert code == 0, said
    assert run.nothing_left()


def test_a_scheduler_that_is_killed_is_told_or_does_no_harm(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", "--robots", "3", "--duration", "60", "--json")
    run.under_way()
    cluster.kill_scheduler()
    _, said = run.process.communicate(timeout=180)
    assert run.process.returncode == 0 or "is lost, with" in said, said
    assert run.nothing_left()
