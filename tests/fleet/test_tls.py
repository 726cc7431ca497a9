"""Access control of robots over the network: real routers and laptops over TLS on this machine."""

import queue
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import zenoh

from actors import messages
from actors.installation.usage import OptionError
from actors.messages import PROGRESS, Control, Drive, Progress
from actors.orders import Order, Pause, Resume, Stop
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from actors.runtime.isolation import credentials, rules
from actors.runtime.isolation.credentials import Credentials
from actors.runtime.isolation.tls import Keys, laptop_config, listening_router_config, load_keys
from actors.topic import Message
from deploy.fleet import operator_station
from deploy.hosts import certificates
from deploy.hosts.certificates import CLIENT, SERVER, CertifiedKey
from tests.fleet.fleet_texts import ROOT

pytestmark = pytest.mark.timeout(60)
NOW = datetime.now(UTC)
SENSES, RECEIVED, DRIVE = "swarm/down/r1/senses", "swarm/down/r1/received", "swarm/up/r1/drive"
CONTROL, TRUTH = "swarm/infra/control", "swarm/infra/truth"


class Robot:
    """A robot's router at a local port, with valid and invalid keys for clients."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.issuer = certificates.create_authority("fleet", NOW, 1)
        self.stranger = certificates.create_authority("fleet", NOW, 1)
        self.own = self.keys("r1", self.issuer, SERVER, ["127.0.0.1"])
        self.issued = self._issued()
        self.endpoint = f"tls/127.0.0.1:{_free_port()}"

    def keys(self, name: str, issuer: CertifiedKey, purpose: Any = CLIENT, hosts: Any = ()) -> Keys:
        """Create a machine's folder of keys."""
        folder = self.folder / f"{name}-{len(list(self.folder.iterdir()))}"
        folder.mkdir()
        pair = certificates.issue_certificate(issuer, name, [purpose], hosts, NOW, 1)
        (folder / "authority.pem").write_bytes(issuer.certificate_pem)
        (folder / "certificate.pem").write_bytes(pair.certificate_pem)
        (folder / "key.pem").write_bytes(pair.private_pem)
        return load_keys(folder)

    @contextmanager
    def router(self) -> Iterator[zenoh.Session]:
        """Open the router's session and publish the sockets of the robot's actors."""
        with zenoh.open(listening_router_config(self.issued, self.own, [self.endpoint])) as session:
            credentials.publish_sockets(self.issued)
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


class MessageProbe:
    """Subscriber to all messages of a session."""

    def __init__(self, session: zenoh.Session) -> None:
        self._subscriber = session.declare_subscriber("swarm/**", zenoh.handlers.FifoChannel(1000))

    def until(self, mark: str) -> list[str]:
        """Return the keys received before the key `mark`."""
        heard: list[str] = []
        while (key := str(self._subscriber.recv().key_expr)) != mark:
            heard.append(key)
        return heard

    def all(self) -> list[str]:
        return [str(sample.key_expr) for sample in iter(self._subscriber.try_recv, None)]

    def close(self) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def assert_powerless(guest: zenoh.Session, router: zenoh.Session, operator: zenoh.Config) -> None:
    probe, own = MessageProbe(router), MessageProbe(guest)
    for key in (DRIVE, CONTROL):
        guest.put(key, b"stop")
    own.until(CONTROL)  # its own loopback
    # By the time the operator has connected and sent an order, the guest's messages would have arrived.
    with zenoh.open(operator) as session:
        session.put(CONTROL, b"")
        assert probe.until(CONTROL) == []
    router.put(SENSES, b"from the base")
    assert probe.until(SENSES) == []
    time.sleep(0.1)  # time for a message that must not arrive
    assert own.all() == []
    probe.close()


def refused(config: zenoh.Config) -> bool:
    """Return whether the connection is refused."""
    try:
        zenoh.open(config).close()  # type: ignore[no-untyped-call]
    except zenoh.ZError:
        return True
    return False


def test_the_operators_laptop_receives_everything_and_may_send_orders_only(
    robot: Robot, router: zenoh.Session
) -> None:
    laptop = laptop_config(robot.keys("operator", robot.issuer), robot.endpoint)
    probe = MessageProbe(router)
    with zenoh.open(laptop) as session:
        own = MessageProbe(session)
        session.put(CONTROL, b"")  # arrives after the subscription
        assert probe.until(CONTROL) == []
        own.until(CONTROL)  # its own loopback
        for key in (SENSES, RECEIVED, TRUTH):
            router.put(key, b"from the base")
        assert sorted(own.until(TRUTH)) == [RECEIVED, SENSES]
        probe.all()
        for key in (DRIVE, SENSES, RECEIVED, TRUTH, "swarm/up/**", CONTROL):
            session.put(key, b"from the laptop")
        assert probe.until(CONTROL) == []
        assert probe.all() == []
    probe.close()


@pytest.mark.parametrize("case", ["no certificate", "of another authority", "trusting ours", "a robot's own"])
def test_only_certificates_of_the_fleets_laptops_are_accepted(
    case: str, robot: Robot, router: zenoh.Session
) -> None:
    keys = robot.keys("operator", robot.issuer if case == "no certificate" else robot.stranger)
    if case == "trusting ours":
        shutil.copy(robot.own.authority, keys.authority)
    elif case == "a robot's own":
        keys = robot.keys("r2", robot.issuer, SERVER, ["127.0.0.1"])
    config = laptop_config(keys, robot.endpoint)
    if case == "no certificate":
        for name in ("connect_certificate", "connect_private_key"):
            config.insert_json5(f"transport/link/tls/{name}", "null")
        config.insert_json5("transport/link/tls/enable_mtls", "false")
    assert refused(config)


@pytest.mark.parametrize("case", ["another name", "the word without a certificate", "r1", "operator"])
def test_sessions_without_exactly_the_operators_certificate_neither_receive_nor_send(
    case: str, robot: Robot, router: zenoh.Session
) -> None:
    """`r1` and `operator`: a password in addition to a laptop's certificate revokes its rights."""
    operator = laptop_config(robot.keys("operator", robot.issuer), robot.endpoint)
    if case == "the word without a certificate":
        file = robot.folder / "guessed"
        file.write_text("certificate:certificate\n")
        config = rules.client_config(file, robot.issued.endpoint("radio"))
        operator = rules.client_config(robot.issued.files["operator"], robot.issued.endpoint("operator"))
    elif case == "another name":
        config = laptop_config(robot.keys("visitor", robot.issuer), robot.endpoint)
    else:
        name, password = credentials.read(robot.issued.files[case])
        config = laptop_config(robot.keys("operator", robot.issuer), robot.endpoint)
        config.insert_json5("transport/auth/usrpwd", f'{{"user": "{name}", "password": "{password}"}}')
    with zenoh.open(config) as guest:
        assert_powerless(guest, router, operator)


def test_a_laptop_refuses_a_robot_whose_certificate_is_for_another_name(
    robot: Robot, router: zenoh.Session
) -> None:
    keys = robot.keys("operator", robot.issuer)
    assert not refused(laptop_config(keys, robot.endpoint))
    assert refused(laptop_config(keys, robot.endpoint.replace("127.0.0.1", "localhost")))


def test_a_robots_password_still_opens_its_own_socket(robot: Robot, router: zenoh.Session) -> None:
    probe = MessageProbe(router)
    config = rules.client_config(robot.issued.files["r1"], robot.issued.endpoint("r1"))
    with zenoh.open(config) as session:
        session.put(DRIVE, b"as r1")
        assert probe.until(DRIVE) == []
    probe.close()


LAPTOP = """
import sys, time, zenoh; from pathlib import Path
from actors.runtime.isolation.tls import laptop_config, load_keys
with zenoh.open(laptop_config(load_keys(Path(sys.argv[1])), sys.argv[2])) as session:
    probe = session.declare_subscriber('swarm/**', zenoh.handlers.FifoChannel(10))
    session.put('swarm/infra/control', b'')
    time.sleep(100)
"""


@pytest.mark.timeout(60, method="thread")  # a signal would not end it
def test_a_laptop_that_stops_reading_does_not_block_the_robot(robot: Robot, tmp_path: Path) -> None:
    """With low latency on this link, the first message without buffer space would block forever.

    The laptop shares no pipes with this process: it is suspended, and their readers would wait for EOF.
    """
    other = Robot(tmp_path)
    keys = other.keys("operator", other.issuer).certificate.parent
    words = [sys.executable, "-c", LAPTOP, str(keys), other.endpoint]
    with other.router() as session:
        probe = MessageProbe(session)
        laptop = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            assert probe.until(CONTROL) == []
            probe.close()
            laptop.send_signal(signal.SIGSTOP)
            for _ in range(20_000):
                session.put(SENSES, bytes(1500), congestion_control=zenoh.CongestionControl.BLOCK)
        finally:
            laptop.kill()
            laptop.wait()


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> list[Robot]:
    """Return two robots of one fleet and one of another."""
    fleet = [Robot(tmp_path_factory.mktemp(f"robot{number}")) for number in range(3)]
    fleet[1].issuer = fleet[0].issuer
    fleet[1].own = fleet[1].keys("r1", fleet[0].issuer, SERVER, ["127.0.0.1"])
    return fleet


@pytest.fixture(scope="module")
def keys(robots: list[Robot]) -> Path:
    """Return the operator's folder of keys."""
    return robots[0].keys("operator", robots[0].issuer).authority.parent


@contextmanager
def base(robot: Robot, *, obeys: bool = True) -> Iterator[list[Order]]:
    """Yield the orders received by a robot, which confirms them if `obeys`."""
    orders: list[Order] = []
    with robot.router() as session:

        def hear(sample: zenoh.Sample) -> None:
            control = decode(messages.CONTROL, messages.CONTROL.key(), sample.payload.to_bytes())  # type: ignore[arg-type]
            assert isinstance(control, Control)
            orders.extend(control.orders)
            (order,) = control.orders
            stopped, paused = isinstance(order, Stop), isinstance(order, Pause)
            if obeys:
                said = encode(Progress(3, 0, 2, 0, stopped, paused))
                threading.Thread(target=session.put, args=(PROGRESS.key(), said)).start()

        subscriber = session.declare_subscriber(messages.CONTROL.key(), hear)
        yield orders
        subscriber.undeclare()  # type: ignore[no-untyped-call]


def test_all_robots_are_stopped_in_parallel_and_failures_are_named(robots: list[Robot], keys: Path) -> None:
    good, deaf, foreign = robots
    with ExitStack() as stack:
        silent = stack.enter_context(socket.socket())
        silent.bind(("127.0.0.1", 0))
        silent.listen(5)
        dumb = f"tls/127.0.0.1:{silent.getsockname()[1]}"
        got = stack.enter_context(base(good))
        heard = stack.enter_context(base(deaf, obeys=False))
        theirs = stack.enter_context(base(foreign))
        closed = f"tls/127.0.0.1:{_free_port()}"
        began = time.monotonic()
        answers = operator_station.send_order(
            [closed, dumb, foreign.endpoint, deaf.endpoint, good.endpoint, good.endpoint], keys, Stop()
        )
        took = time.monotonic() - began
    assert took < 2.5, "2 s, plus the start of threads on a loaded machine"
    assert got == heard == [Stop()] and theirs == []
    late = "no connection within 2 s"
    assert [*answers.items()] == [
        (closed, f"{late}: connection refused"),
        (dumb, f"{late}: no response within 1.5 s"),
        (
            foreign.endpoint,
            f"{late}: its certificate is rejected: unable to get local issuer certificate",
        ),
        (deaf.endpoint, "the order was sent, but not confirmed within 2 s"),
        (good.endpoint, None),
    ]


def test_a_rejected_laptop_certificate_is_reported_as_cause(
    robots: list[Robot],
) -> None:
    mixed = robots[0].keys("operator", robots[0].stranger)
    shutil.copy(robots[0].own.authority, mixed.authority)
    with base(robots[0]) as got:
        (failure,) = operator_station.send_order(
            [robots[0].endpoint], mixed.authority.parent, Stop()
        ).values()
    assert got == [] and failure is not None
    assert failure.startswith("no connection within 2 s: it rejects this laptop's certificate: ")


def test_the_command_prints_each_robots_result_and_exits_with_1_after_a_failure(
    robots: list[Robot], keys: Path
) -> None:
    closed = f"tls/127.0.0.1:{_free_port()}"
    with base(robots[0]) as got:
        for endpoint, right in (
            ("tcp/r1:7447", "like tls/192.168.1.12:7447"),
            ("tls/r1:70000", "one with a"),
        ):
            with pytest.raises(OptionError, match=f"^ENDPOINT: {endpoint}; must be {right}"):
                operator_station.send_order([robots[0].endpoint, endpoint], keys, Stop())
        for order in (Pause(), Resume()):
            assert operator_station.send_order([robots[0].endpoint], keys, order) == {
                robots[0].endpoint: None
            }
        assert got == [Pause(), Resume()]
        words = ("fleet", "stop", closed, robots[0].endpoint, "--keys", str(keys))
        command = [sys.executable, "-m", "acrc_testbed.command_line", *words]  # it exits its process
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (
        1,
        f"acrc: {robots[0].endpoint}: stopped\n",
        f"acrc: {closed}: no connection within 2 s: connection refused\n",
    )


def test_watching_continues_without_one_of_the_robots_and_reconnects(robots: list[Robot], keys: Path) -> None:
    one, other, closed = robots[0], robots[1], f"tls/127.0.0.1:{_free_port()}"
    names = (closed, one.endpoint, other.endpoint)
    words = ("fleet", "watch", *names, "--keys", str(keys))
    command = [sys.executable, "-u", "-m", "acrc_testbed.command_line", *words]
    with one.router() as first:
        watcher = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert watcher.stdout is not None
        lines = iter(watcher.stdout.readline, "")

        def until(*wanted: str) -> None:
            left = set(wanted)
            while left:
                left.discard(next(lines).rstrip("\n"))

        try:
            refused = "not connected, retrying: connection refused"
            until(f"{closed}  {refused}", f"{other.endpoint}  {refused}", f"{one.endpoint}  connected")
            with other.router():
                until(f"{other.endpoint}  connected")
            until(f"{other.endpoint}  connection lost, reconnecting")
            first.put(PROGRESS.key(), encode(Progress(7, 0, 2, 1, False)))
            until(f"{one.endpoint}  step 7: 2 items left, 1 reported, running")
            held = ("battery nearly empty", "a wheel\x1b[2J")
            first.put(PROGRESS.key(), encode(Progress(8, 0, 2, 1, False, held=held)))
            until(f"{one.endpoint}  step 8: 2 items left, 1 reported, running, {held[0]}, a wheel\\x1b[2J")
            with other.router():
                until(f"{other.endpoint}  connected")
        finally:
            watcher.kill()
            watcher.wait()


def test_listeners_pass_on_messages_of_further_topics(
    robots: list[Robot], keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operator_station, "_RETRY_DELAY_S", 3600.0)  # its thread never exits
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    taken: list[tuple[str, str, Message]] = []
    drive = Drive(7, 0.1, 0.0, 0.0, 0, pose=(1.0, 2.0, 0.5))
    with robots[0].router() as session:
        operator_station.start_listeners(
            [robots[0].endpoint],
            keys,
            lines,
            further_addresses=(at(messages.DRIVE, "*"),),
            on_message=lambda *words: taken.append(words),
        )
        deadline = time.monotonic() + 20.0
        while len(taken) < 2 and time.monotonic() < deadline:
            session.put(messages.DRIVE.key("r1"), encode(drive))
            session.put(PROGRESS.key(), encode(Progress(3, 0, 2, 0, False)))
            time.sleep(0.05)
    assert (robots[0].endpoint, messages.DRIVE.key("r1"), drive) in taken
    said = [lines.get_nowait() for _ in range(lines.qsize())]
    assert f"{robots[0].endpoint}  connected" in said
    assert any(line.endswith("step 3: 2 items left, 0 reported, running") for line in said)
