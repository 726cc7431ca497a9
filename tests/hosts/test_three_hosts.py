"""Twenty robots over three hosts."""

from pathlib import Path

import pytest

from benchmarks.hosts.cluster import TlsCluster
from benchmarks.hosts.namespaces import Hosts
from tests.hosts.hosted_runs import HostedRun, digest_here


@pytest.mark.timeout(400)
def test_twenty_robots_on_three_hosts_have_the_digest_of_one_computer(tmp_path: Path) -> None:
    words = ("--robots", "20", "--duration", "4", "--seed", "2", "--json")
    with Hosts(3, disk_bytes=24 << 20) as three, TlsCluster(three, tmp_path / "cluster") as cluster:
        run = HostedRun(three, cluster, tmp_path / "hosted", *words)
        assert run.digest() == digest_here(tmp_path / "here", *words)
        assert run.nothing_left()
        assert run.folders_left() == []
    kept = {path.name for path in (tmp_path / "hosted" / "r20").iterdir()}
    assert kept == {"map.png", "map.yaml", "own", "r20.log", "r20.mcap", "setup.json"}
