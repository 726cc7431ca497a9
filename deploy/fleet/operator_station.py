"""Operator station: monitors robots over the network, and stops, pauses or resumes them."""

import queue
import re
import socket
import ssl
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from actors.installation.usage import wrong_value
from actors.instant import in_seconds
from actors.messages import BOARD, CONTROL, PROGRESS, Board, Control, Progress
from actors.orders import Order, Pause, Resume, Stop
from actors.runtime.codec import arrived, decode, encode
from actors.runtime.core import Address, at
from actors.runtime.errors import AcrcError, printable
from actors.runtime.isolation.tls import Keys, laptop_config, load_keys
from actors.runtime.zenoh_bus import ZenohBus, open_session
from actors.topic import Message
from deploy.hosts.address import host_and_port
from firmware_bridge.serial_port import Say, changed_only

_REFUSAL_TIMEOUT_S = 0.3
"""Timeout for a robot's rejection of our certificate, which in TLS 1.3 follows the handshake, s."""


def connection_fault(endpoint: str, keys: Keys, machine: str = "laptop") -> str:
    """Return why this `machine` cannot connect to `tls/HOST:PORT`; empty if a handshake succeeds."""
    host, port = host_and_port(endpoint)
    try:
        context = ssl.create_default_context(cafile=str(keys.authority))
        context.load_cert_chain(keys.certificate, keys.private_key)
        with (
            socket.create_connection((host, port), _CAUSE_TIMEOUT_S) as plain,
            context.wrap_socket(plain, server_hostname=host) as secure,
        ):
            secure.settimeout(_REFUSAL_TIMEOUT_S)
            return _refusal(secure, machine)
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is rejected: {error.verify_message.rstrip('.')}"
    except ssl.SSLError as error:
        return f"TLS handshake failed: {(error.reason or str(error)).replace('_', ' ').lower()}"
    except TimeoutError:
        return f"no response within {_CAUSE_TIMEOUT_S:g} s"
    except OSError as error:
        return (error.strerror or str(error)).lower()


def _refusal(secure: ssl.SSLSocket, machine: str) -> str:
    try:
        return "" if secure.recv(1) else "it closed the connection"
    except TimeoutError:
        return ""  # a router waits for the client's first message
    except ssl.SSLError as error:
        return f"it rejects this {machine}'s certificate: {(error.reason or '').replace('_', ' ').lower()}"


_ORDER_TIMEOUT_S: Final = 2.0
"""Timeout for the confirmation of an order, s; our choice."""
_CAUSE_TIMEOUT_S: Final = 1.5
"""Timeout for finding the cause of a failed connection, s; our choice, below `_ORDER_TIMEOUT_S`."""
_RETRY_DELAY_S: Final = 1.0
"""Delay before reconnecting to a robot, s; our choice."""
_POLL_INTERVAL_S: Final = 0.02
"""Period of polling for messages, s; our choice, a hundredth of `_ORDER_TIMEOUT_S`."""


STATE_AFTER: Final[Mapping[type[Order], str]] = {
    Stop: "stopped",
    Pause: "paused until resumed",
    Resume: "resumed",
}
"""The robot's state after each order, in words."""


def send_order(endpoints: Sequence[str], keys: Path, order: Order) -> dict[str, str | None]:
    """Send an order to all robots in parallel, for at most `_ORDER_TIMEOUT_S`.

    Return why the order is not confirmed, by endpoint; None: the robot confirmed it. Raises AcrcError for an
    invalid endpoint or keys, before anything is sent.
    """
    loaded_keys, names = _check_endpoints(endpoints, keys)
    deadline = time.monotonic() + _ORDER_TIMEOUT_S
    failures: dict[str, str | None] = dict.fromkeys(names, f"no connection within {_ORDER_TIMEOUT_S:g} s")
    causes: dict[str, str] = {}

    def send(endpoint: str) -> None:
        try:
            with open_session(laptop_config(loaded_keys, endpoint), deadline - time.monotonic()) as session:
                bus = ZenohBus(session, (at(PROGRESS),))
                bus.publish(CONTROL.key(), encode(Control(0, (order,))))
                failures[endpoint] = f"the order was sent, but not confirmed within {_ORDER_TIMEOUT_S:g} s"
                while time.monotonic() < deadline:
                    if any(_is_confirmed(progress, order) for progress in arrived(bus, PROGRESS)):
                        failures[endpoint] = None
                        return
                    time.sleep(_POLL_INTERVAL_S)
        except AcrcError:
            return  # the failure is already recorded
        except Exception as error:  # report any failure for this robot only
            failures[endpoint] = f"the order may not have been received: {error}"

    def find_cause(endpoint: str) -> None:
        causes[endpoint] = connection_fault(endpoint, loaded_keys)

    # Daemon threads: connection attempts that hang must not delay the exit.
    threads = [
        threading.Thread(target=task, args=(name,), daemon=True)
        for task in (send, find_cause)
        for name in names
    ]
    for thread in threads:
        thread.start()
    for thread in threads[: len(names)]:
        thread.join(max(0.0, deadline - time.monotonic()))
    return {
        name: f"{failure}: {causes[name]}" if failure and causes.get(name) else failure
        for name, failure in failures.items()
    }


def _is_confirmed(progress: Progress, order: Order) -> bool:
    return progress.finished if isinstance(order, Stop) else progress.paused == isinstance(order, Pause)


def watch(endpoints: Sequence[str], keys: Path) -> None:
    """Print a line for every report of every robot, until interrupted.

    A lost connection is reported once, and retried until it succeeds.
    """
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    start_listeners(endpoints, keys, lines)
    while True:
        sys.stdout.write(f"{lines.get()}\n")
        sys.stdout.flush()


def start_listeners(
    endpoints: Sequence[str],
    keys: Path,
    lines: "queue.SimpleQueue[str]",
    further_addresses: Sequence[Address] = (),
    on_message: Callable[[str, str, Message], None] = lambda endpoint, key, message: None,
) -> None:
    """Put a line for every report of every robot into `lines`, from daemon threads.

    `on_message`: called with endpoint, key and message for all messages, also on `further_addresses`; must
    not block. Raises AcrcError for an invalid endpoint or keys.
    """
    loaded_keys, names = _check_endpoints(endpoints, keys)
    addresses = (at(PROGRESS), at(BOARD), *further_addresses)

    def receive(endpoint: str, say: Say) -> None:
        """Pass on messages until the session with the robot's router ends."""
        with open_session(laptop_config(loaded_keys, endpoint), 0.0) as session:
            bus = ZenohBus(session, addresses, lossy=len(addresses) > 2)
            say("connected")
            while session.info.routers_zid():
                for address in addresses:
                    while (delivery := bus.poll(address.topic)) is not None:
                        message = decode(delivery.topic, delivery.key, delivery.payload)
                        on_message(endpoint, delivery.key, message)
                        for line in _lines(message):
                            lines.put(f"{endpoint}  {line}")
                time.sleep(_POLL_INTERVAL_S)
        say("connection lost, reconnecting")

    def listen(endpoint: str) -> None:
        """Listen forever, reconnecting after failures; report changes of the connection."""
        say = changed_only(lambda state: lines.put(f"{endpoint}  {state}"))
        while True:
            try:
                receive(endpoint, say)
            except Exception as error:  # a failure of one robot must not affect the others
                say(f"not connected, retrying: {connection_fault(endpoint, loaded_keys) or error}")
            time.sleep(_RETRY_DELAY_S)

    for name in names:
        threading.Thread(target=listen, args=(name,), daemon=True).start()


def _check_endpoints(endpoints: Sequence[str], keys: Path) -> tuple[Keys, list[str]]:
    """Return the keys and the distinct endpoints. Raises AcrcError if one is invalid."""
    for endpoint in endpoints:
        match = re.fullmatch(r"tls/.+:(\d+)", endpoint)
        if match is None:
            raise wrong_value("ENDPOINT", endpoint, "like tls/192.168.1.12:7447")
        if not 0 < int(match[1][:6]) < 65536:
            raise wrong_value("ENDPOINT", endpoint, "one with a port from 1 to 65535")
    return load_keys(keys), list(dict.fromkeys(endpoints))


def _lines(message: Message) -> list[str]:
    """Return the printed lines of a message; [] for data messages."""
    if isinstance(message, Progress):
        return [f"step {message.step}: {progress_text(message)}"]
    if isinstance(message, Board):
        return [f"{in_seconds(note.instant):.3f} {note}" for note in message.notes]
    return []


def progress_text(progress: Progress) -> str:
    """Return a robot's progress, in words."""
    state = "stopped" if progress.finished else "paused" if progress.paused else "running"
    return (
        f"{progress.left} items left, {progress.done} reported, "
        f"{', '.join((state, *map(printable, progress.held)))}"
    )
