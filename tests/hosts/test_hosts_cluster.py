"""A Dask cluster with TLS comes up over hosts, loses a worker, and leaves nothing."""

import errno
import json
import signal
import ssl
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.hosts.cluster import ADDRESS, PORT, TlsCluster, TlsClusterError
from benchmarks.hosts.host import HERE
from benchmarks.hosts.namespaces import Hosts
from benchmarks.hosts.relay_process import RelayProcess
from tests.hosts.on_host import connected_from, eventually, listening_on, socket_on

COMPUTE = """
import json, operator, socket, sys
from distributed import Client
with Client(sys.argv[1], timeout=30) as client:
    workers = client.scheduler_info(n_workers=-1)["workers"]
    answers = {}
    for address, about in workers.items():
        two = client.submit(operator.add, 1, 1, workers=[address], pure=False)
        name = client.submit(socket.gethostname, workers=[address], pure=False)
        answers[about["name"]] = [two.result(30), name.result(30), about["host"]]
    print(json.dumps(answers))
"""


def computed(hosts: Hosts, cluster: TlsCluster) -> dict[str, list[object]]:
    """Answer and host name of each worker, and from where the scheduler knows it."""
    done = subprocess.run(
        hosts.here.command([sys.executable, "-c", COMPUTE, ADDRESS]),
        env=cluster.environment,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr + cluster.log("here")
    answers: dict[str, list[object]] = json.loads(done.stdout)
    return answers


def test_a_cluster_computes_on_each_host_and_outlives_a_worker(hosts: Hosts, tmp_path: Path) -> None:
    first, second = hosts.each
    all_of_them = {"h1": [2, "h1", first.address], "h2": [2, "h2", second.address]}
    with (
        RelayProcess(hosts.here, f"{first.here_address}:0", f"{HERE}:{PORT}", delay_ms=1.0) as relay,
        TlsCluster(hosts, tmp_path / "cluster", through={"h1": f"tls://{relay.address}"}) as cluster,
    ):
        assert computed(hosts, cluster) == all_of_them
        assert f"Registered to: tls://{relay.address}" in " ".join(cluster.log("h1").split())
        with connected_from(first, (HERE, PORT)) as plain, pytest.raises(ssl.SSLError):
            ssl._create_unverified_context().wrap_socket(plain).recv(1)  # without a certificate
        cluster.kill_worker(1)
        assert eventually(lambda: f"Remove worker addr: tls://{second.address}" in cluster.log("here"))
        cluster.start_worker(1)
        assert computed(hosts, cluster) == all_of_them
        cluster.kill_scheduler()
        with socket_on(first) as one:
            assert one.connect_ex((HERE, PORT)) == errno.ECONNREFUSED
        cluster.start_scheduler()
        connected_from(first, (HERE, PORT)).close()
        left = subprocess.Popen(first.command(["sleep", "600"]))
    assert left.wait(10.0) == -signal.SIGKILL
    for host in (hosts.here, first, second):
        assert host.processes() == []


def test_what_does_not_start_is_named_with_its_log(hosts: Hosts, tmp_path: Path) -> None:
    folder = tmp_path / "cluster"
    with (
        listening_on(hosts.here, (HERE, PORT)),
        pytest.raises(TlsClusterError) as caught,
        TlsCluster(hosts, folder),
    ):
        pass
    assert str(caught.value) == (
        f"dask_scheduler on here does not start; see {folder}/here.log: "
        "RuntimeError: Scheduler failed to start."
    )
    assert hosts.here.processes() == []
