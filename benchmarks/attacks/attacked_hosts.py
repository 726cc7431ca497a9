"""A mesh over two hosts, all on this computer, with the sessions of a run, for attacks on it."""

import socket
import ssl
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import zenoh

from actors.messages import DRIVE
from actors.runtime.access import credentials, hosts
from actors.runtime.access.credentials import Credentials, Gate, reveal
from actors.runtime.access.rules import CERTIFIED, client_config
from actors.runtime.access.session_config import session_config, set_value
from actors.runtime.access.tls import Keys, load_keys
from actors.runtime.bus.zenoh_bus import open_session
from deploy.hosts import certificates, run_keys, run_tls
from deploy.hosts.certificates import CLIENT
from deploy.hosts.listening import free_port
from deploy.hosts.run_tls import PemKeys

HERE: Final = "127.0.0.1"
ROBOTS: Final = {"h1": ("r1",), "h2": ("r2",)}
_SETTLE_S: Final = 0.3
"""For what was sent before the mark, on another way."""
_PATIENCE_S: Final = 20.0


class AttackedHosts:
    """The world's router, hosts h1 with r1 and h2 with r2, and whoever wants in."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack = stack
        self._folder = folder
        self._keys = run_keys.draw(list(ROBOTS), HERE)
        self.endpoint = f"tls/{HERE}:{free_port(HERE)}"
        self._heard: list[str] = []
        self._marks = 0
        issued = credentials.issue({}, self._made("world"))
        gate = Gate(self.endpoint, self._written("keys", self._keys.world), ROBOTS)
        self._world = self._open(hosts.world_config(_with_gate(issued, gate)))
        for key in ("swarm/up/**", "swarm/infra/**"):
            self._world.declare_subscriber(key, _into(self._heard))
        reveal(issued)
        self.robots = {robot: self._robot(host, robot) for host, (robot,) in ROBOTS.items()}
        self._told: dict[str, list[str]] = {"r1": [], "r2": []}
        for robot, session in self.robots.items():
            session.declare_subscriber(f"swarm/down/{robot}/**", _into(self._told[robot]))
        self._await_links()

    def keys(self, name: str) -> Keys:
        """The run's own keys of a host."""
        return load_keys(self._written(f"{name}-stolen", self._keys.hosts[name]))

    def expired_keys(self) -> Keys:
        """Keys of h1 as this run's authority would have signed them, in the past."""
        then = datetime.now(UTC) - timedelta(days=10)
        return load_keys(self._written("expired", _signed(self._keys.issuer, "h1", then)))

    def foreign_keys(self) -> Keys:
        """Keys of h1 in another run, with this run's authority to believe in."""
        other = run_keys.draw(["h1"], HERE).hosts["h1"]
        mixed = PemKeys(self._keys.world.authority, other.certificate, other.private_key)
        return load_keys(self._written("foreign", mixed))

    def enter(self, keys: Keys | None) -> zenoh.Session:
        """A session of one's own at the world's port. Raises AcrcError where it is not let in."""
        config = session_config("client")
        set_value(config, "connect/endpoints", [self.endpoint])
        set_value(config, "connect/timeout_ms", 1500)
        set_value(config, "connect/exit_on_failure", True)
        set_value(config, "transport/auth/usrpwd", {"user": CERTIFIED, "password": CERTIFIED})
        authority = {"root_ca_certificate": str(self._folder / "keys" / "authority.pem")}
        set_value(config, "transport/link/tls", authority if keys is None else keys.connecting)
        return self._open(config)

    def control(self, keys: Keys | None) -> bool:
        """Whether somebody with these keys is let in where hosts report to the run."""
        server = run_tls.server_context(self._folder / "keys")
        listener = socket.create_server((HERE, 0))
        client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        client.load_verify_locations(self._folder / "keys" / "authority.pem")
        if keys is not None:
            client.load_cert_chain(keys.certificate, keys.private_key)
        return _handshake(listener, server, client)

    def world_hears(self, token: str) -> bool:
        """Whether the world has heard the token, once all that was sent before has come."""
        self._mark()
        return any(token in text for text in self._heard)

    def robot_hears(self, robot: str, token: str) -> bool:
        """The same of a robot."""
        self._mark()
        return any(token in text for text in self._told[robot])

    def told(self, robot: str) -> list[str]:
        """All that a robot has heard."""
        return self._told[robot]

    def tell(self, robot: str, token: str) -> None:
        """Let the world tell a robot a secret."""
        self._world.put(f"swarm/down/{robot}/senses", token)

    def _mark(self) -> None:
        self._marks += 1
        mark = f"mark {self._marks}"
        self.robots["r1"].put(DRIVE.key("r1"), mark)
        _until(lambda: mark in self._heard)
        for robot in self.robots:
            self.tell(robot, mark)
            _until(lambda robot=robot: mark in self._told[robot])
        time.sleep(_SETTLE_S)

    def _robot(self, host: str, robot: str) -> zenoh.Session:
        issued = credentials.issue({robot: self._made(f"{host}-{robot}")}, self._made(host), ())
        keys = load_keys(self._written(f"{host}-keys", self._keys.hosts[host]))
        self._open(hosts.host_config(issued, keys, self.endpoint))
        reveal(issued)
        return self._open(client_config(issued.files[robot], issued.endpoint(robot)))

    def _await_links(self) -> None:
        """Until each robot is heard, and hears."""
        for robot, session in self.robots.items():
            publisher: Any = session.declare_publisher(DRIVE.key(robot))
            _until(lambda publisher=publisher: publisher.matching_status.matching)
            heard = self._world.declare_publisher(f"swarm/down/{robot}/senses")
            _until(lambda heard=heard: heard.matching_status.matching)

    def _open(self, config: zenoh.Config) -> zenoh.Session:
        return self._stack.enter_context(open_session(config, 0.0))

    def _made(self, name: str) -> Path:
        (self._folder / name).mkdir()
        return self._folder / name

    def _written(self, name: str, keys: PemKeys) -> Path:
        if not (self._folder / name).exists():
            keys.write(self._folder / name)
        return self._folder / name


@contextmanager
def attacked_hosts() -> Iterator[AttackedHosts]:
    """The mesh, for as long as it is attacked."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as name, ExitStack() as stack:
        yield AttackedHosts(stack, Path(name))


def _with_gate(issued: Credentials, gate: Gate) -> Credentials:
    return Credentials(issued.robots, issued.others, issued.dictionary, issued.files, issued.sockets, gate)


def _signed(issuer: certificates.Pair, name: str, then: datetime) -> PemKeys:
    pair = certificates.machine(issuer, name, [CLIENT], [], then, 2)
    return PemKeys(issuer.certificate_pem, pair.certificate_pem, pair.private_pem)


def _handshake(listener: socket.socket, server: ssl.SSLContext, client: ssl.SSLContext) -> bool:
    """Whether the server takes what the client shows, which the client need not have noticed."""
    with listener, socket.create_connection(listener.getsockname()) as theirs:
        ours, _ = listener.accept()
        ours.setblocking(False)
        theirs.setblocking(False)
        ends = [
            server.wrap_socket(ours, server_side=True, do_handshake_on_connect=False),
            client.wrap_socket(theirs, server_hostname=HERE, do_handshake_on_connect=False),
        ]
        done = [False, False]
        deadline = time.monotonic() + _PATIENCE_S
        try:
            while not all(done) and time.monotonic() < deadline:
                for number, end in enumerate(ends):
                    try:
                        end.do_handshake()
                        done[number] = True
                    except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
                        continue
        except (ssl.SSLError, OSError):
            return False
        finally:
            for end in ends:
                end.close()
        return all(done)


def _into(heard: list[str]) -> Callable[[zenoh.Sample], None]:
    return lambda sample: heard.append(sample.payload.to_string())


def _until(holds: Any) -> None:
    deadline = time.monotonic() + _PATIENCE_S
    while not holds():
        if time.monotonic() > deadline:
            raise TimeoutError("the mesh over two hosts does not come up")
        time.sleep(0.01)
