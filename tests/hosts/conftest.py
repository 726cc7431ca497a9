"""Two hosts for the tests of a file."""

from collections.abc import Iterator

import pytest

from benchmarks.hosts.namespaces import Hosts

DISK = 4 << 20
"""Bytes of each host's own."""


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    with Hosts(2, disk_bytes=DISK) as made:
        yield made
