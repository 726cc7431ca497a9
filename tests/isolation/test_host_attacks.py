"""Attacks on the links between computers: by outsiders, and by a host on another host's robots."""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh

from actors.messages import DRIVE
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials, tls
from actors.runtime.isolation.credentials import Credentials, HostGateway, publish_sockets
from actors.runtime.isolation.rules import CERTIFIED, client_config, session_config, set_value
from actors.runtime.isolation.tls import Keys, load_keys
from actors.runtime.zenoh_bus import open_session
from deploy.hosts import certificates
from deploy.hosts.address import free_port
from deploy.hosts.certificates import PemKeys

pytestmark = [pytest.mark.claim("attacks"), pytest.mark.nightly]
HERE = "127.0.0.1"
ROBOTS = {"h1": ("r1",), "h2": ("r2",)}
SETTLE_S = 0.3
"""Wait for messages that take another path than the mark, s."""


class AttackedHosts:
    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._folder, self._marks = stack, folder, 0
        self._world_keys, self._keys = certificates.create_run_keys(list(ROBOTS), HERE)
        self._endpoint = f"tls/{HERE}:{free_port(HERE)}"
        self._heard: dict[str, list[str]] = {"world": [], "r1": [], "r2": []}
        issued = credentials.issue({}, self._made("world"))
        gate = HostGateway(self._endpoint, self._written("keys", self._world_keys), ROBOTS)
        with_gate = Credentials(
            issued.robots, issued.others, issued.dictionary, issued.files, issued.sockets, gate
        )
        self._world = self._open(tls.world_config(with_gate))
        for key in ("swarm/up/**", "swarm/infra/**"):
            self._world.declare_subscriber(key, _into(self._heard["world"]))
        publish_sockets(issued)
        self.robots = {robot: self._robot(host, robot) for host, (robot,) in ROBOTS.items()}
        for robot, session in self.robots.items():
            session.declare_subscriber(f"swarm/down/{robot}/**", _into(self._heard[robot]))
            up: Any = session.declare_publisher(DRIVE.key(robot))
            _until(partial(_has_match, up))
            down: Any = self._world.declare_publisher(f"swarm/down/{robot}/senses")
            _until(partial(_has_match, down))

    def stolen_keys(self) -> Keys:
        return load_keys(self._written("stolen", self._keys["h2"]))

    def foreign_keys(self) -> Keys:
        other = certificates.create_run_keys(["h1"], HERE)[1]["h1"]
        mixed = PemKeys(self._world_keys.authority, other.certificate, other.private_key)
        return load_keys(self._written("foreign", mixed))

    def enter(self, keys: Keys | None) -> zenoh.Session:
        config = session_config("client")
        set_value(config, "connect/endpoints", [self._endpoint])
        set_value(config, "connect/timeout_ms", 1500)
        set_value(config, "connect/exit_on_failure", True)
        set_value(config, "transport/auth/usrpwd", {"user": CERTIFIED, "password": CERTIFIED})
        authority = {"root_ca_certificate": str(self._folder / "keys" / "authority.pem")}
        set_value(config, "transport/link/tls", authority if keys is None else keys.connecting)
        return self._open(config)

    def hears(self, actor: str, token: str) -> bool:
        self._marks += 1
        mark = f"mark {self._marks}"
        self.robots["r1"].put(DRIVE.key("r1"), mark)
        _until(lambda: mark in self._heard["world"])
        for robot in self.robots:
            self.tell(robot, mark)
            _until(partial(self._heard[robot].__contains__, mark))
        time.sleep(SETTLE_S)
        return any(token in text for text in self._heard[actor])

    def tell(self, robot: str, token: str) -> None:
        self._world.put(f"swarm/down/{robot}/senses", token)

    def _robot(self, host: str, robot: str) -> zenoh.Session:
        issued = credentials.issue({robot: self._made(f"{host}-{robot}")}, self._made(host), ())
        keys = load_keys(self._written(f"{host}-keys", self._keys[host]))
        self._open(tls.host_config(issued, keys, self._endpoint))
        publish_sockets(issued)
        return self._open(client_config(issued.files[robot], issued.endpoint(robot)))

    def _open(self, config: zenoh.Config) -> zenoh.Session:
        return self._stack.enter_context(open_session(config, 0.0))

    def _made(self, name: str) -> Path:
        (self._folder / name).mkdir()
        return self._folder / name

    def _written(self, name: str, keys: PemKeys) -> Path:
        if not (self._folder / name).exists():
            keys.write(self._folder / name)
        return self._folder / name


def _into(heard: list[str]) -> Callable[[zenoh.Sample], None]:
    return lambda sample: heard.append(sample.payload.to_string())


def _has_match(publisher: Any) -> bool:
    return bool(publisher.matching_status.matching)


def _until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20.0
    while not holds():
        assert time.monotonic() < deadline, "the mesh over two hosts does not start"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def attacked() -> Iterator[AttackedHosts]:
    with tempfile.TemporaryDirectory(prefix="acrc-", dir="/tmp") as name, ExitStack() as stack:
        yield AttackedHosts(stack, Path(name))  # short, because a socket's path may have 107 bytes


def test_controls_hosts_and_their_robots_are_heard(attacked: AttackedHosts) -> None:
    attacked.robots["r1"].put(DRIVE.key("r1"), "own robot")
    attacked.enter(attacked.stolen_keys()).put(DRIVE.key("r2"), "own host")
    assert attacked.hears("world", "own robot")
    assert attacked.hears("world", "own host")


@pytest.mark.parametrize("keys", [lambda attacked: None, AttackedHosts.foreign_keys])
def test_clients_without_a_certificate_of_this_run_are_rejected(
    attacked: AttackedHosts, keys: Callable[[AttackedHosts], Keys | None]
) -> None:
    try:
        session = attacked.enter(keys(attacked))
    except AcrcError:
        return
    heard: list[str] = []
    session.declare_subscriber("swarm/**", _into(heard))
    session.put(DRIVE.key("r1"), "outsider")
    attacked.tell("r1", "secret")
    assert attacked.hears("r1", "secret")
    assert not attacked.hears("world", "outsider")
    assert heard == []


def test_a_host_acts_only_for_its_own_robots(attacked: AttackedHosts) -> None:
    session = attacked.enter(attacked.stolen_keys())
    heard: list[str] = []
    for key in ("swarm/**", "swarm/down/r1/**", DRIVE.key("r1")):
        session.declare_subscriber(key, _into(heard))
    session.put(DRIVE.key("r1"), "forged drive")
    session.put("swarm/down/r1/senses", "forged senses")
    session.put("swarm/infra/aired", "forged radio")
    attacked.robots["r1"].put("swarm/down/r2/senses", "forged by r1")
    attacked.tell("r1", "secret")
    assert attacked.hears("r1", "secret")
    assert not attacked.hears("world", "forged")
    assert not attacked.hears("r1", "forged senses")
    assert not attacked.hears("r2", "forged by r1")
    assert not any("secret" in text for text in heard)
