"""The keys of one run over several computers: an authority that nobody keeps, and what it has signed.

The private keys of hosts travel to them through the cluster; the authority's own is never written.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from deploy.hosts import certificates
from deploy.hosts.certificates import CLIENT, SERVER, Pair
from deploy.hosts.run_tls import PemKeys

_DAYS: Final = 30
"""Longer than any run; whoever finds the keys of an ended run finds nobody who would take them."""


@dataclass(frozen=True)
class RunKeys:
    """Everybody's keys for one run."""

    world: PemKeys
    """Of the computer on which the run was started."""
    hosts: dict[str, PemKeys]
    issuer: Pair
    """The authority: whoever drew the keys may sign more, and forgets it then."""


def draw(hosts: Sequence[str], address: str) -> RunKeys:
    """New keys. `hosts`: their common names. `address`: where the first computer is connected to."""
    now = datetime.now(UTC)
    issuer = certificates.authority("run", now, _DAYS)
    world = certificates.machine(issuer, "world", [SERVER], [address], now, _DAYS)
    made = {name: certificates.machine(issuer, name, [CLIENT], [], now, _DAYS) for name in hosts}
    return RunKeys(_keys(issuer, world), {name: _keys(issuer, pair) for name, pair in made.items()}, issuer)


def _keys(issuer: Pair, pair: Pair) -> PemKeys:
    return PemKeys(issuer.certificate_pem, pair.certificate_pem, pair.private_pem)
