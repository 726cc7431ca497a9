"""Attacks on a swarm over several computers: by whoever reaches its ports, and by one of its own hosts.

`python -m benchmarks.attacks.host_attacks` prints the table of docs/isolation.md.
"""

import secrets
import sys
from collections.abc import Callable
from typing import Final, NamedTuple

from actors.messages import DRIVE
from actors.runtime.access.tls import Keys
from actors.runtime.errors import AcrcError
from benchmarks.attacks.attacked_hosts import AttackedHosts

_NO_CERTIFICATE: Final = "mutual TLS: no certificate of this run"


class HostAttack(NamedTuple):
    """A way to say or hear something over the links between computers."""

    name: str
    closed_by: str
    """The mechanism, for the table in docs/isolation.md."""
    act: Callable[[AttackedHosts], bool]
    """Carries it out; whether it got through."""
    control: bool = False
    """It must get through: else nothing is shown by what does not."""


def _says(keys: Callable[[AttackedHosts], Keys | None], key: str) -> Callable[[AttackedHosts], bool]:
    """Say something on a key with a session of one's own at the world's port."""

    def act(swarm: AttackedHosts) -> bool:
        token = secrets.token_hex(8)
        try:
            swarm.enter(keys(swarm)).put(key, token)
        except AcrcError:
            return False
        return swarm.world_hears(token) or swarm.robot_hears("r1", token)

    return act


def _hears(keys: Callable[[AttackedHosts], Keys | None]) -> Callable[[AttackedHosts], bool]:
    """Hear what r1 is told, and what it says."""

    def act(swarm: AttackedHosts) -> bool:
        heard: list[str] = []
        try:
            session = swarm.enter(keys(swarm))
            for key in ("swarm/**", "swarm/down/r1/**", "swarm/up/r1/**", DRIVE.key("r1")):
                session.declare_subscriber(key, lambda sample: heard.append(sample.payload.to_string()))
        except AcrcError:
            return False
        tokens = [secrets.token_hex(8), secrets.token_hex(8)]
        swarm.tell("r1", tokens[0])
        swarm.robots["r1"].put(DRIVE.key("r1"), tokens[1])
        if not swarm.world_hears(tokens[1]):
            raise AssertionError("the world does not hear its own robot")
        return any(token in text for token in tokens for text in heard)

    return act


def _robot_says(robot: str, key: str) -> Callable[[AttackedHosts], bool]:
    def act(swarm: AttackedHosts) -> bool:
        token = secrets.token_hex(8)
        swarm.robots[robot].put(key, token)
        return swarm.world_hears(token) or swarm.robot_hears("r2", token)

    return act


def _nobody(swarm: AttackedHosts) -> None:
    return None


def _h2(swarm: AttackedHosts) -> Keys:
    return swarm.keys("h2")


_OUTSIDERS: Final[tuple[tuple[str, Callable[[AttackedHosts], Keys | None]], ...]] = (
    ("without a certificate", _nobody),
    ("with a certificate that has expired", AttackedHosts.expired_keys),
    ("with another run's certificate", AttackedHosts.foreign_keys),
)

HOST_ATTACKS: Final = (
    HostAttack(
        "a robot on a host speaks for itself", "nothing", _robot_says("r1", DRIVE.key("r1")), control=True
    ),
    HostAttack(
        "a host speaks for its own robot",
        "nothing",
        _says(lambda swarm: swarm.keys("h1"), DRIVE.key("r1")),
        control=True,
    ),
    HostAttack(
        "a host reports to the run", "nothing", lambda swarm: swarm.control(swarm.keys("h1")), control=True
    ),
    *(
        HostAttack(
            f"over the network, {who}, say something as r1", _NO_CERTIFICATE, _says(keys, DRIVE.key("r1"))
        )
        for who, keys in _OUTSIDERS
    ),
    *(
        HostAttack(f"over the network, {who}, hear r1 and the world", _NO_CERTIFICATE, _hears(keys))
        for who, keys in _OUTSIDERS
    ),
    *(
        HostAttack(
            f"over the network, {who}, report as a host",
            _NO_CERTIFICATE,
            lambda swarm, keys=keys: swarm.control(keys(swarm)),  # type: ignore[misc]
        )
        for who, keys in _OUTSIDERS
    ),
    HostAttack("a host speaks for another host's robot", "access rules", _says(_h2, DRIVE.key("r1"))),
    HostAttack(
        "a host speaks as the world to another host's robot",
        "access rules",
        _says(_h2, "swarm/down/r1/senses"),
    ),
    HostAttack("a host speaks as the radio", "access rules", _says(_h2, "swarm/infra/aired")),
    HostAttack("a host hears another host's robot and the world", "access rules", _hears(_h2)),
    HostAttack("a robot speaks for one on another host", "access rules", _robot_says("r1", DRIVE.key("r2"))),
    HostAttack(
        "a robot speaks to one on another host", "access rules", _robot_says("r1", "swarm/down/r2/senses")
    ),
)


def host_table() -> str:
    """One line per attack, in Markdown."""
    lines = ["| way over the links between computers | closed by |", "|---|---|"]
    lines += [f"| {attack.name} | {attack.closed_by} |" for attack in HOST_ATTACKS if not attack.control]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(f"{host_table()}\n")
