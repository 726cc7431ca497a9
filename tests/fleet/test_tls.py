"""Who may watch a robot over the network: real routers and laptops over TLS on this machine."""

import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import zenoh

from actors.runtime.access import credentials, rules
from actors.runtime.access.credentials import Credentials
from actors.runtime.access.tls import Keys, laptop_config, listening_router_config, load_keys
from deploy.hosts import certificates
from deploy.hosts.certificates import CLIENT, SERVER, Pair
from tests.fleet.texts import ROOT

pytestmark = pytest.mark.timeout(60)
NOW = datetime.now(UTC)
SENSES, RECEIVED, DRIVE = "swarm/down/r1/senses", "swarm/down/r1/received", "swarm/up/r1/drive"
CONTROL, TRUTH = "swarm/infra/control", "swarm/infra/truth"


class Robot:
    """A robot's router that listens at a port of this machine, and all keys that one could show to it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.issuer = certificates.authority("fleet", NOW, 1)
        self.stranger = certificates.authority("fleet", NOW, 1)
        self.own = self.keys("r1", self.issuer, SERVER, ["127.0.0.1"])
        self.issued = self._issued()
        self.endpoint = f"tls/127.0.0.1:{_free_port()}"

    def keys(self, name: str, issuer: Pair, purpose: Any = CLIENT, hosts: Any = ()) -> Keys:
        """A machine's folder of keys."""
        folder = self.folder / f"{name}-{len(list(self.folder.iterdir()))}"
        folder.mkdir()
        pair = certificates.machine(issuer, name, [purpose], hosts, NOW, 1)
        (folder / "authority.pem").write_bytes(issuer.certificate_pem)
        (folder / "certificate.pem").write_bytes(pair.certificate_pem)
        (folder / "key.pem").write_bytes(pair.private_pem)
        return load_keys(folder)

    @contextmanager
    def router(self) -> Iterator[zenoh.Session]:
        """The router's session, with the sockets of the robot's own actors named."""
        with zenoh.open(listening_router_config(self.issued, self.own, [self.endpoint])) as session:
            credentials.reveal(self.issued)
            yield session

    def _issued(self) -> Credentials:
        for name in ("r1", "infra"):
            (self.folder / name).mkdir()
        return credentials.issue({"r1": self.folder / "r1"}, self.folder / "infra", ["radio", "operator"])


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return Robot(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def router(robot: Robot) -> Iterator[zenoh.Session]:
    with robot.router() as session:
        yield session


class Ear:
    """Hears everything that a session is sent; a mark says when all before it has come."""

    def __init__(self, session: zenoh.Session) -> None:
        self._subscriber = session.declare_subscriber("swarm/**", zenoh.handlers.FifoChannel(1000))

    def until(self, mark: str) -> list[str]:
        """The keys before the mark's."""
        heard: list[str] = []
        while (key := str(self._subscriber.recv().key_expr)) != mark:
            heard.append(key)
        return heard

    def all(self) -> list[str]:
        """What has come."""
        return [str(sample.key_expr) for sample in iter(self._subscriber.try_recv, None)]

    def close(self) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def assert_powerless(guest: zenoh.Session, router: zenoh.Session, operator: zenoh.Config) -> None:
    """What the guest sends comes to nobody, and it is sent nothing."""
    ear, own = Ear(router), Ear(guest)
    guest.put(CONTROL, b"stop")
    own.until(CONTROL)  # its own loopback
    # The guest's attempts are long through, or not, when the operator has connected and given an order.
    with zenoh.open(operator) as session:
        session.put(CONTROL, b"")
        assert ear.until(CONTROL) == []
    router.put(SENSES, b"from the base")
    assert ear.until(SENSES) == []
    time.sleep(0.1)  # nothing can tell when nothing has come
    assert own.all() == []
    ear.close()


def refused(config: zenoh.Config) -> bool:
    """True if no session comes about."""
    try:
        zenoh.open(config).close()  # type: ignore[no-untyped-call]
    except zenoh.ZError:
        return True
    return False


def test_the_operators_laptop_hears_everything_and_may_give_orders_but_nothing_else(
    robot: Robot, router: zenoh.Session
) -> None:
    laptop = laptop_config(robot.keys("operator", robot.issuer), robot.endpoint)
    ear = Ear(router)
    with zenoh.open(laptop) as session:
        own = Ear(session)
        session.put(CONTROL, b"")  # comes through behind the subscription
        assert ear.until(CONTROL) == []
        own.until(CONTROL)  # its own loopback
        for key in (SENSES, RECEIVED, TRUTH):
            router.put(key, b"from the base")
        assert sorted(own.until(TRUTH)) == [RECEIVED, SENSES]
        ear.all()
        for key in (DRIVE, SENSES, RECEIVED, TRUTH, "swarm/up/**", CONTROL):
            session.put(key, b"from the laptop")
        assert ear.until(CONTROL) == []
        assert ear.all() == []
    ear.close()


@pytest.mark.parametrize(
    ("case", "let_in"),
    [
        ("no certificate", False),
        ("of another authority", False),
        ("of another authority, trusting ours", False),
        ("a robot's own", False),
        ("under another name", True),
    ],
)
def test_whoever_is_not_the_operator_is_refused_or_hears_nothing(
    case: str, let_in: bool, robot: Robot, router: zenoh.Session
) -> None:
    config = _laptop(case, robot)
    assert refused(config) is not let_in
    if not let_in:
        return
    with zenoh.open(config) as session:
        assert_powerless(session, router, laptop_config(robot.keys("operator", robot.issuer), robot.endpoint))


def _laptop(case: str, robot: Robot) -> zenoh.Config:
    match case:
        case "of another authority":
            return laptop_config(robot.keys("operator", robot.stranger), robot.endpoint)
        case "of another authority, trusting ours":
            keys = robot.keys("operator", robot.stranger)
            shutil.copy(robot.own.authority, keys.authority)
            return laptop_config(keys, robot.endpoint)
        case "a robot's own":
            return laptop_config(robot.keys("r2", robot.issuer, SERVER, ["127.0.0.1"]), robot.endpoint)
        case "under another name":
            return laptop_config(robot.keys("visitor", robot.issuer), robot.endpoint)
    config = laptop_config(robot.keys("operator", robot.issuer), robot.endpoint)
    for name in ("connect_certificate", "connect_private_key"):
        config.insert_json5(f"transport/link/tls/{name}", "null")
    config.insert_json5("transport/link/tls/enable_mtls", "false")
    return config


def test_a_laptop_refuses_a_robot_under_a_name_that_its_certificate_does_not_hold_for(
    robot: Robot, router: zenoh.Session
) -> None:
    keys = robot.keys("operator", robot.issuer)
    assert not refused(laptop_config(keys, robot.endpoint))
    assert refused(laptop_config(keys, robot.endpoint.replace("127.0.0.1", "localhost")))


def test_the_word_that_goes_with_a_certificate_opens_nothing_without_one(
    robot: Robot, router: zenoh.Session
) -> None:
    file = robot.folder / "guessed"
    file.write_text("certificate:certificate\n")
    with zenoh.open(rules.client_config(file, robot.issued.endpoint("radio"))) as session:
        assert_powerless(
            session,
            router,
            rules.client_config(robot.issued.files["operator"], robot.issued.endpoint("operator")),
        )


@pytest.mark.parametrize("user", ["r1", "operator"])
def test_a_certificate_and_a_password_do_not_add_up(user: str, robot: Robot, router: zenoh.Session) -> None:
    """Neither the rights of the one nor those of the other: over TLS the certificate alone counts."""
    name, password = credentials.read(robot.issued.files[user])
    config = laptop_config(robot.keys("operator", robot.issuer), robot.endpoint)
    config.insert_json5("transport/auth/usrpwd", f'{{"user": "{name}", "password": "{password}"}}')
    operator = laptop_config(robot.keys("operator", robot.issuer), robot.endpoint)
    with zenoh.open(config) as session:
        assert_powerless(session, router, operator)
        ear = Ear(router)
        session.put(DRIVE, b"as r1")
        with zenoh.open(operator) as own:
            own.put(CONTROL, b"")
            assert ear.until(CONTROL) == []
        ear.close()


def test_a_robots_password_goes_on_opening_its_own_socket(robot: Robot, router: zenoh.Session) -> None:
    ear = Ear(router)
    config = rules.client_config(robot.issued.files["r1"], robot.issued.endpoint("r1"))
    with zenoh.open(config) as session:
        session.put(DRIVE, b"as r1")
        assert str(ear._subscriber.recv().key_expr) == DRIVE
    ear.close()


@pytest.mark.timeout(30, method="thread")  # a signal would not end it
def test_a_laptop_that_stops_reading_does_not_hold_the_robot_up(robot: Robot, tmp_path: Path) -> None:
    """With low latency on this link the first of these messages that finds no room would wait for ever."""
    other = Robot(tmp_path)
    keys = other.keys("operator", other.issuer).certificate.parent
    with other.router() as session:
        code = (
            "import sys, time, zenoh; from pathlib import Path\n"
            "from actors.runtime.access.tls import laptop_config, load_keys\n"
            "with zenoh.open(laptop_config(load_keys(Path(sys.argv[1])), sys.argv[2])) as session:\n"
            "    ear = session.declare_subscriber('swarm/**', zenoh.handlers.FifoChannel(10))\n"
            "    session.put('swarm/infra/control', b'')\n"
            "    time.sleep(100)\n"
        )
        ear = Ear(session)
        with subprocess.Popen([sys.executable, "-c", code, keys, other.endpoint], cwd=ROOT) as laptop:
            assert ear.until(CONTROL) == []
            ear.close()
            laptop.send_signal(signal.SIGSTOP)
            for _ in range(20_000):
                session.put(SENSES, bytes(1500), congestion_control=zenoh.CongestionControl.BLOCK)
            laptop.kill()
