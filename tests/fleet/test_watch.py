"""Orders to several robots at once over TLS, some of which are not there, silent, or somebody else's."""

import queue
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh

from actors.installation.usage import OptionError
from actors.messages import CONTROL, DRIVE, PROGRESS, Control, Drive, Progress
from actors.orders import Order, Pause, Resume, Stop
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from actors.topic import Message
from deploy.fleet import watch
from deploy.fleet.watch import WatchAnswer
from deploy.hosts.certificates import SERVER
from tests.fleet.test_tls import Robot
from tests.fleet.texts import ROOT

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> list[Robot]:
    """Two robots of one fleet, and one of another."""
    fleet = [Robot(tmp_path_factory.mktemp(f"robot{number}")) for number in range(3)]
    fleet[1].issuer = fleet[0].issuer
    fleet[1].own = fleet[1].keys("r1", fleet[0].issuer, SERVER, ["127.0.0.1"])
    return fleet


@pytest.fixture(scope="module")
def keys(robots: list[Robot]) -> Path:
    """The operator's folder."""
    return robots[0].keys("operator", robots[0].issuer).authority.parent


@contextmanager
def base(robot: Robot, *, obeys: bool = True) -> Iterator[list[Order]]:
    """The orders that a robot has got; it says what became of them, or nothing."""
    orders: list[Order] = []
    with robot.router() as session:

        def hear(sample: zenoh.Sample) -> None:
            control = decode(CONTROL, CONTROL.key(), sample.payload.to_bytes())  # type: ignore[arg-type]
            assert isinstance(control, Control)
            orders.extend(control.orders)
            (order,) = control.orders
            stopped, paused = isinstance(order, Stop), isinstance(order, Pause)
            if obeys:
                said = encode(Progress(3, 0, 2, 0, stopped, paused))
                threading.Thread(target=session.put, args=(PROGRESS.key(), said)).start()

        subscriber = session.declare_subscriber(CONTROL.key(), hear)
        yield orders
        subscriber.undeclare()  # type: ignore[no-untyped-call]


def unused() -> str:
    """An endpoint at which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tls/127.0.0.1:{probe.getsockname()[1]}"


def test_all_robots_are_stopped_at_once_and_every_failure_is_named(robots: list[Robot], keys: Path) -> None:
    good, deaf, foreign = robots
    with ExitStack() as stack:
        silent = stack.enter_context(socket.socket())
        silent.bind(("127.0.0.1", 0))
        silent.listen(5)
        dumb = f"tls/127.0.0.1:{silent.getsockname()[1]}"
        got = stack.enter_context(base(good))
        heard = stack.enter_context(base(deaf, obeys=False))
        theirs = stack.enter_context(base(foreign))
        nobody = unused()
        began = time.monotonic()
        answers = watch.give(
            [nobody, dumb, foreign.endpoint, deaf.endpoint, good.endpoint, good.endpoint], keys, Stop()
        )
        took = time.monotonic() - began
    assert took < 2.5, "2 s, and what a loaded machine takes to start threads"
    assert got == heard == [Stop()] and theirs == []
    late = "it was not reached within 2 s"
    assert answers == [
        WatchAnswer(nobody, f"{late}: connection refused"),
        WatchAnswer(dumb, f"{late}: no answer within 1.5 s"),
        WatchAnswer(
            foreign.endpoint,
            f"{late}: its certificate is not accepted here, unable to get local issuer certificate",
        ),
        WatchAnswer(deaf.endpoint, "it was given the order, but did not say within 2 s that it obeys"),
        WatchAnswer(good.endpoint, None),
    ]


def test_a_router_that_does_not_know_this_laptop_is_told_from_one_that_is_not_there(
    robots: list[Robot], tmp_path: Path
) -> None:
    robot = robots[0]
    stranger = robot.keys("operator", robot.stranger)
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    (mixed / "authority.pem").write_bytes(robot.issuer.certificate_pem)
    for name in ("certificate.pem", "key.pem"):
        (mixed / name).write_bytes((stranger.authority.parent / name).read_bytes())
    with base(robot) as got:
        (answer,) = watch.give([robot.endpoint], mixed, Stop())
    assert got == []
    assert answer.failure is not None
    assert answer.failure.startswith(
        "it was not reached within 2 s: it does not accept this laptop's certificate"
    )


def test_the_command_says_what_each_robot_does_and_ends_with_1_if_one_does_not(
    robots: list[Robot], keys: Path
) -> None:
    nobody = unused()
    with base(robots[0]) as got:
        for order in (Pause(), Resume()):
            assert watch.give([robots[0].endpoint], keys, order) == [WatchAnswer(robots[0].endpoint, None)]
        assert got == [Pause(), Resume()]
        words = ("fleet", "stop", nobody, robots[0].endpoint, "--keys", str(keys))
        command = [sys.executable, "-m", "command_line", *words]  # it ends its process at once
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (
        1,
        f"acrc: {robots[0].endpoint}: has stopped\n",
        f"acrc: {nobody}: it was not reached within 2 s: connection refused\n",
    )


@pytest.mark.parametrize(
    ("endpoint", "sentence"),
    [
        ("tcp/r1:7447", "ENDPOINT: tcp/r1:7447; must be like tls/192.168.1.12:7447"),
        ("tls/r1:70000", "ENDPOINT: tls/r1:70000; must be one with a port from 1 to 65535"),
    ],
)
def test_what_is_no_endpoint_is_refused_before_anybody_is_told_anything(
    endpoint: str, sentence: str, robots: list[Robot], keys: Path
) -> None:
    with base(robots[0]) as got, pytest.raises(OptionError) as caught:
        watch.give([robots[0].endpoint, endpoint], keys, Stop())
    assert str(caught.value) == sentence
    assert got == []


def test_watching_lives_on_without_one_of_the_robots_and_finds_it_again(
    robots: list[Robot], keys: Path
) -> None:
    one, other, nobody = robots[0], robots[1], unused()
    names = (nobody, one.endpoint, other.endpoint)
    command = [sys.executable, "-u", "-m", "command_line", "fleet", "watch", *names, "--keys", str(keys)]
    with one.router() as first:
        watcher = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert watcher.stdout is not None
        lines = iter(watcher.stdout.readline, "")

        def until(*wanted: str) -> None:
            left = set(wanted)
            while left:
                left.discard(next(lines).rstrip("\n"))

        try:
            refused = "is not heard: connection refused; it is looked for"
            until(f"{nobody}  {refused}", f"{other.endpoint}  {refused}", f"{one.endpoint}  is heard")
            with other.router():
                until(f"{other.endpoint}  is heard")
            until(f"{other.endpoint}  is no longer heard; it is looked for")
            first.put(PROGRESS.key(), encode(Progress(7, 0, 2, 1, False)))
            until(f"{one.endpoint}  step 7: 2 places left, 1 reported, running")
            held = ("the battery is nearly empty", "a wheel\x1b[2J")
            first.put(PROGRESS.key(), encode(Progress(8, 0, 2, 1, False, held=held)))
            until(f"{one.endpoint}  step 8: 2 places left, 1 reported, running, {held[0]}, a wheel\\x1b[2J")
            with other.router():
                until(f"{other.endpoint}  is heard")
        finally:
            watcher.kill()
            watcher.wait()


def test_whoever_draws_robots_hears_what_they_hold_and_never_holds_a_listener_up(
    robots: list[Robot], keys: Path
) -> None:
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    taken: list[tuple[str, str, Message]] = []
    drive = Drive(7, 0.1, 0.0, 0.0, 0, pose=(1.0, 2.0, 0.5))
    with robots[0].router() as session:
        watch.listen(
            [robots[0].endpoint],
            keys,
            lines,
            more=(at(DRIVE, "*"),),
            take=lambda *words: taken.append(words),
        )
        deadline = time.monotonic() + 20.0
        while len(taken) < 2 and time.monotonic() < deadline:
            session.put(DRIVE.key("r1"), encode(drive))
            session.put(PROGRESS.key(), encode(Progress(3, 0, 2, 0, False)))
            time.sleep(0.05)
    assert (robots[0].endpoint, DRIVE.key("r1"), drive) in taken
    said = [lines.get_nowait() for _ in range(lines.qsize())]
    assert f"{robots[0].endpoint}  is heard" in said
    assert any(line.endswith("step 3: 2 places left, 0 reported, running") for line in said)
