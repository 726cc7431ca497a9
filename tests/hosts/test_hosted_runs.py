"""Swarms over several computers: the digest of one computer, and errors that name a failed host."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from acrc_testbed.benchmarks.benchmark_result import ACRC
from acrc_testbed.benchmarks.hosts import ADDRESS, Hosts, HostsError, TlsCluster
from acrc_testbed.explanation.time_accounting import account_time
from acrc_testbed.recordings import record_check
from acrc_testbed.recordings.record_replay import recheck
from acrc_testbed.results import seal
from acrc_testbed.results.seal import check_seal
from acrc_testbed.run_model.simulated_runs import RunReader
from actors.runtime.errors import AcrcError
from tests.swarm.command import run as run_here

ROOT = Path(__file__).parents[2]
LONG = ("--robots", "4", "--duration", "3000", "--seed", "1", "--timeout", "5")
pytestmark = pytest.mark.timeout(400)
OWN = """
from pathlib import Path
from cleaning.strategies.chapter import behaviour as chapter

def behaviour(start):
    print("here I am")
    if Path.cwd().name == "own":
        Path("diary").write_text("kept")
    return chapter(start)
"""


def eventually(holds: Callable[[], object]) -> bool:
    deadline = time.monotonic() + 10.0
    while not holds():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


class HostedRun:
    def __init__(self, hosts: Hosts, cluster: TlsCluster, out: Path, *words: str) -> None:
        self.out, self.hosts = out, hosts
        command = [*ACRC, "run", "--on", ADDRESS, "--out", str(out), *words]
        self.process = subprocess.Popen(
            hosts.here.command(command), cwd=ROOT, env=cluster.environment, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def under_way(self) -> None:
        recording, deadline = self.out / "r1/r1.mcap", time.monotonic() + 300
        while not recording.is_file() or recording.stat().st_size < 20_000:
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < deadline, self.out
            time.sleep(0.05)

    def ended(self) -> tuple[int, str]:
        """Return the exit code and the last line of standard error."""
        _, errors = self.process.communicate(timeout=300)
        return self.process.returncode, errors.strip().splitlines()[-1]

    def result(self) -> tuple[str, str]:
        out, errors = self.process.communicate(timeout=300)
        assert self.process.returncode == 0, errors
        return json.loads(out)["digest"], errors

    def nothing_left(self) -> bool:
        return eventually(lambda: all(len(host.processes()) <= 1 for host in self.hosts.each))

    def left(self, *words: str) -> list[str]:
        found: list[str] = []
        for host in self.hosts.each:
            find = host.command(["find", str(host.disk), *words])
            found += subprocess.run(find, capture_output=True, text=True, check=True).stdout.split()
        return found

    def folders_left(self) -> list[str]:
        return self.left("-mindepth", "1", "-maxdepth", "1", "-name", "acrc-*")

    def secrets_left(self) -> list[str]:
        """Return keys and passwords of runs on the hosts' disks."""
        names = ("(", "-name", "credentials", "-o", "-name", "key.pem", "-o", "-name", "users", ")")
        return self.left("-path", "*/acrc-*/*", *names)


def digest_here(out: Path, *words: str) -> str:
    return str(run_here(out, *words, "--bus", "memory")["digest"])


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    with Hosts(2, disk_bytes=24 << 20) as made:
        yield made


@pytest.fixture(scope="module")
def cluster(hosts: Hosts, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TlsCluster]:
    with TlsCluster(hosts, tmp_path_factory.mktemp("cluster") / "c") as made:
        yield made


def acrc(hosts: Hosts, cluster: TlsCluster, *words: object) -> subprocess.CompletedProcess[str]:
    command = hosts.here.command([sys.executable, "-P", "-m", "acrc_testbed.command_line", *map(str, words)])
    return subprocess.run(
        command, cwd=ROOT, env=cluster.environment, capture_output=True, text=True, check=False, timeout=180
    )


def test_a_run_over_two_hosts_has_the_digest_of_one_computer(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "mine.py").write_text(OWN)
    words = ("--robots", "4", "--duration", "3", "--json", "--strategy", "mine:behaviour")
    code, out = ("--modules", str(tmp_path / "code")), tmp_path / "hosted"
    run = HostedRun(hosts, cluster, out, *words, *code, "--log", "*", "--leave")
    digest, errors = run.result()
    assert digest == digest_here(tmp_path / "here", *words, *code)
    for robot in ("r1", "r4"):
        assert f"{robot}       0.000 s  step 0  here I am" in errors
    assert (out / "r2" / "own" / "diary").read_text() == "kept"
    assert f"{out}/r1/r1.mcap and 3 more are still on hosts h1, h2; fetch with `" in errors
    assert list(out.glob("r[0-9]/*.mcap")) == [] and len(run.folders_left()) == 2
    assert run.secrets_left() == []
    told = seal.read_hosts(out)
    assert told is not None
    assert [part.robots for part in told.hosts.values()] == [("r1", "r2"), ("r3", "r4")]
    for wants_robots in (account_time, record_check.check_run, check_seal, recheck):
        with pytest.raises(AcrcError, match=r"still on hosts h1, h2; fetch with `\S+ cluster fetch"):
            wants_robots(out)
    fetched = acrc(hosts, cluster, "cluster", "fetch", out, "--json")
    assert fetched.returncode == 0, fetched.stderr
    assert json.loads(fetched.stdout)["files"] == 4
    assert run.folders_left() == [] and run.nothing_left()
    assert record_check.check_run(out).digest == digest
    assert check_seal(out) is not None


@pytest.mark.nightly
@pytest.mark.parametrize(("delay_ms", "stall_s"), [(10.0, 6), (0.0, 45)])
def test_slow_and_stalled_links_change_nothing_and_are_reported(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path, delay_ms: float, stall_s: int
) -> None:
    """45 s: longer than Dask's own timeout of a connection."""
    with suppress(HostsError):  # a kernel without netem: stalls only
        hosts.delay(delay_ms)
    words = ("--robots", "3", "--duration", "20", "--json")
    run = HostedRun(hosts, cluster, tmp_path / "hosted", *words)
    run.under_way()
    hosts.stall(stalled=True)
    time.sleep(stall_s)
    hosts.stall(stalled=False)
    digest, errors = run.result()
    assert digest == digest_here(tmp_path / "here", *words)
    assert "no answer from host h1 for 5 s; the run waits for it" in errors
    assert "host h1 answers again" in errors


@pytest.mark.nightly
def test_a_killed_worker_ends_the_run_with_its_name_and_recordings_are_fetched(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", *LONG)
    run.under_way()
    cluster.kill("h1")
    code, error = run.ended()
    assert code == 1
    assert error == "acrc: host h1 is lost, with r1, r2: its worker has ended, or left the cluster"
    assert run.nothing_left() and run.secrets_left() == []
    cluster.start_worker(hosts.each[0])
    acrc(hosts, cluster, "cluster", "fetch", tmp_path / "out")
    assert run.folders_left() == []
    with RunReader(tmp_path / "out") as reader:
        assert reader.robots == ("r1", "r2", "r3", "r4")


@pytest.mark.nightly
def test_a_stopped_host_ends_the_run_with_its_name(hosts: Hosts, cluster: TlsCluster, tmp_path: Path) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", *LONG)
    run.under_way()
    hosts.each[1].signal(signal.SIGSTOP)
    try:
        code, error = run.ended()
    finally:
        hosts.each[1].signal(signal.SIGCONT)
    assert code == 1
    assert error.startswith("acrc: host h2 is lost, with r3, r4: no answer for 20 s")
    assert run.nothing_left()


@pytest.mark.nightly
def test_an_interrupt_ends_everything(hosts: Hosts, cluster: TlsCluster, tmp_path: Path) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", *LONG)
    run.under_way()
    run.process.send_signal(signal.SIGINT)
    assert run.ended()[0] == 130
    assert len(list((tmp_path / "out").glob("r[0-9]/*.mcap"))) == 4
    assert run.nothing_left()


@pytest.mark.nightly
def test_a_full_disk_on_a_host_is_reported_with_its_name(
    hosts: Hosts, cluster: TlsCluster, tmp_path: Path
) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", *LONG)
    run.under_way()
    host = hosts.each[1]
    fill = ["sh", "-c", f"head -c 30M /dev/zero > {host.disk}/full; true"]
    subprocess.run(host.command(fill), check=True, capture_output=True)
    try:
        code, error = run.ended()
    finally:
        subprocess.run(host.command(["rm", "-f", f"{host.disk}/full"]), check=True)
    assert code == 1
    assert "(on host h2)" in error and "no space left on device" in error
    assert run.nothing_left()


@pytest.mark.nightly
def test_an_order_reaches_robots_on_hosts(hosts: Hosts, cluster: TlsCluster, tmp_path: Path) -> None:
    run = HostedRun(hosts, cluster, tmp_path / "out", *LONG)
    run.under_way()
    for words in (("kill", "r3"), ("stop",)):
        done = acrc(hosts, cluster, "order", run.out, *words)
        assert done.returncode == 0, done.stderr
    code, error = run.ended()
    assert code == 0, error
    assert run.nothing_left()


@pytest.mark.nightly
@pytest.mark.parametrize("killed", ["run", "scheduler"])
def test_a_host_ends_its_robots_when_the_run_or_the_scheduler_is_killed(tmp_path: Path, killed: str) -> None:
    with Hosts(1, disk_bytes=24 << 20) as one, TlsCluster(one, tmp_path / "cluster") as cluster:
        run = HostedRun(one, cluster, tmp_path / "out", "--robots", "2", *LONG[2:])
        run.under_way()
        if killed == "run":
            run.process.kill()
            run.process.communicate()
        else:
            cluster.kill("here")
            error = run.ended()[1]
            assert error == "acrc: host h1 is lost, with r1, r2: the connection to the scheduler broke"
        assert run.nothing_left() and run.secrets_left() == []
        assert len(run.folders_left()) == 1  # recordings that did not come


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_sixty_robots_on_one_host_have_one_digest(tmp_path: Path) -> None:
    """Regression: with a buffer of one step's size, three of ten such runs stalled."""
    words = ("--robots", "60", "--duration", "10", "--timeout", "8", "--json")
    with Hosts(1, disk_bytes=256 << 20) as one, TlsCluster(one, tmp_path / "cluster") as cluster:
        digests = {HostedRun(one, cluster, tmp_path / f"{turn}", *words).result()[0] for turn in range(6)}
    assert len(digests) == 1
