"""Twenty robots over three hosts, and sixty on one."""

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


@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_sixty_robots_on_one_host_never_wait_for_what_stayed_in_a_link(tmp_path: Path) -> None:
    """With a buffer that a step fills, three of ten such runs came to a stop."""
    words = ("--robots", "60", "--duration", "10", "--timeout", "8", "--json")
    with Hosts(1, disk_bytes=256 << 20) as one, TlsCluster(one, tmp_path / "cluster") as cluster:
        digests = {HostedRun(one, cluster, tmp_path / f"{turn}", *words).digest() for turn in range(6)}
    assert len(digests) == 1
