"""The operator's laptop: sees how robots on board get on, and can stop them."""

import queue
import socket
import ssl
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.installation.usage import wrong_value
from actors.instant import in_seconds
from actors.messages import BOARD, CONTROL, PROGRESS, Board, Control, Progress
from actors.orders import Order, Pause, Resume, Stop
from actors.runtime.codec import decode, encode
from actors.runtime.core import Address, at
from actors.runtime.errors import AcrcError, printable
from actors.runtime.isolation.tls import Keys, laptop_config, load_keys
from actors.runtime.zenoh_bus import ZenohBus, open_session
from actors.topic import Message

_REFUSAL_S = 0.3
"""How long a robot may take to refuse the laptop's certificate, which TLS 1.3 tells after the handshake."""


def cause(endpoint: str, keys: Keys) -> str:
    """Return what keeps this laptop from a session with `tls/HOST:PORT`; empty if a handshake succeeds."""
    host, _, port = endpoint.removeprefix("tls/").rpartition(":")
    host = host.strip("[]")
    try:
        context = ssl.create_default_context(cafile=str(keys.authority))
        context.load_cert_chain(keys.certificate, keys.private_key)
        with (
            socket.create_connection((host, int(port)), _CAUSE_S) as plain,
            context.wrap_socket(plain, server_hostname=host) as secure,
        ):
            secure.settimeout(_REFUSAL_S)
            return _refusal(secure)
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is not accepted here, {error.verify_message.rstrip('.')}"
    except ssl.SSLError as error:
        return f"no secure connection, {(error.reason or str(error)).replace('_', ' ').lower()}"
    except TimeoutError:
        return f"no answer within {_CAUSE_S:g} s"
    except OSError as error:
        return (error.strerror or str(error)).lower()


def _refusal(secure: ssl.SSLSocket) -> str:
    try:
        return "" if secure.recv(1) else "it closed the connection"
    except TimeoutError:
        return ""  # a router waits for the first word
    except ssl.SSLError as error:
        return (
            f"it does not accept this laptop's certificate, {(error.reason or '').replace('_', ' ').lower()}"
        )


_ORDER_S: Final = 2.0
"""Within which an order is carried out by a robot or named as a failure. Own choice: as long as somebody who
sees a robot go wrong will look at a screen."""
_CAUSE_S: Final = 1.5
"""How long it may take to find out why a robot is not reached. Own choice: less than `_ORDER_S`."""
_RETRY_S: Final = 1.0
"""Between attempts to reach a robot that is watched. Own choice."""
_LOOK_S: Final = 0.02
"""Between looks at what has come. Own choice: a hundredth of `_ORDER_S`."""


@dataclass(frozen=True)
class WatchAnswer:
    """What became of an order to one robot."""

    endpoint: str
    failure: str | None
    """Why it is not known to have been carried out, in a sentence; None: the robot says that it has been."""


_DONE = {Stop: "has stopped", Pause: "stands until it is told to go on", Resume: "goes on"}


def done(order: Order) -> str:
    """What a robot does that has carried the order out."""
    return _DONE[type(order)]


def give(endpoints: Sequence[str], keys: Path, order: Order) -> list[WatchAnswer]:
    """Give all robots an order at once; return each one's answer, after `_ORDER_S` at the latest.

    One that cannot be reached delays none of the others. Raises an AcrcError for an endpoint or keys that
    make no sense, before any robot is told anything.
    """
    own, names = _checked(endpoints, keys)
    deadline = time.monotonic() + _ORDER_S
    failures: dict[str, str | None] = dict.fromkeys(names, f"it was not reached within {_ORDER_S:g} s")
    causes: dict[str, str] = {}

    def tell(endpoint: str) -> None:
        try:
            for failure in _tell(endpoint, own, order, deadline):
                failures[endpoint] = failure
        except AcrcError:
            return  # what has failed stands there already
        except Exception as error:  # whatever it is, it has to be said of this robot, and of no other
            failures[endpoint] = f"it may not have got the order: {error}"

    def ask(endpoint: str) -> None:
        causes[endpoint] = cause(endpoint, own)

    # Daemons: a connection attempt that hangs in the system is left behind, not waited for.
    threads = [threading.Thread(target=tell, args=(name,), daemon=True) for name in names]
    for thread in (*threads, *(threading.Thread(target=ask, args=(name,), daemon=True) for name in names)):
        thread.start()
    for thread in threads:
        thread.join(max(0.0, deadline - time.monotonic()))
    return [_answer(name, failures[name], causes) for name in names]


def _answer(endpoint: str, failure: str | None, causes: Mapping[str, str]) -> WatchAnswer:
    why = causes.get(endpoint) if failure else ""
    return WatchAnswer(endpoint, f"{failure}: {why}" if why else failure)


def _tell(endpoint: str, keys: Keys, order: Order, deadline: float) -> Iterator[str | None]:
    """Give one robot the order; yield each failure so far, and None once the robot obeys."""
    with open_session(laptop_config(keys, endpoint), deadline - time.monotonic()) as session:
        bus = ZenohBus(session, (at(PROGRESS),))
        bus.publish(CONTROL.key(), encode(Control(0, (order,))))
        yield f"it was given the order, but did not say within {_ORDER_S:g} s that it obeys"
        while time.monotonic() < deadline:
            if any(_obeys(message, order) for _, message in _messages(bus, at(PROGRESS))):
                yield None
                return
            time.sleep(_LOOK_S)


def _messages(bus: ZenohBus, address: Address) -> Iterator[tuple[str, Message]]:
    """Yield key and message of what has come."""
    while (delivery := bus.poll(address.topic)) is not None:
        yield delivery.key, decode(delivery.topic, delivery.key, delivery.payload)


def _obeys(progress: Message, order: Order) -> bool:
    assert isinstance(progress, Progress)
    return progress.finished if isinstance(order, Stop) else progress.paused == isinstance(order, Pause)


def watch(endpoints: Sequence[str], keys: Path) -> None:
    """Print a line for every report of every robot, until interrupted.

    A robot that is not there, or is so no longer, is reported once, and looked for until it is back.
    """
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    listen(endpoints, keys, lines)
    while True:
        try:
            sys.stdout.write(lines.get(timeout=0.1) + "\n")
        except queue.Empty:
            sys.stdout.flush()


def listen(
    endpoints: Sequence[str],
    keys: Path,
    lines: "queue.SimpleQueue[str]",
    more: Sequence[Address] = (),
    take: Callable[[str, str, Message], None] = lambda endpoint, key, message: None,
) -> None:
    """Put a line for every report of every robot into `lines`, from threads that end with this process.

    `take` is given, with endpoint and key, every message itself, and those on the addresses `more`, of which
    there are no lines; it must not wait. Raises an AcrcError for an endpoint or keys that make no sense.
    """
    own, names = _checked(endpoints, keys)
    for name in names:
        listener = _Listener(name, own, lines, more, take)
        threading.Thread(target=listener.listen, daemon=True).start()


class _Listener:
    """Reports what one robot reports, and whether it can be heard."""

    def __init__(
        self,
        endpoint: str,
        keys: Keys,
        lines: "queue.SimpleQueue[str]",
        more: Sequence[Address],
        take: Callable[[str, str, Message], None],
    ) -> None:
        self._addresses = (at(PROGRESS), at(BOARD), *more)
        self._take = take
        self._endpoint = endpoint
        self._keys = keys
        self._lines = lines
        self._state = ""

    def listen(self) -> None:
        """Never returns."""
        while True:
            try:
                self._session()
            except Exception as error:  # whatever one robot does must not end the watch over the others
                self._set_state(
                    f"is not heard: {cause(self._endpoint, self._keys) or error}; it is looked for"
                )
            time.sleep(_RETRY_S)

    def _session(self) -> None:
        """Pass on what comes until the session with the robot's router ends."""
        with open_session(laptop_config(self._keys, self._endpoint), 0.0) as session:
            bus = ZenohBus(session, self._addresses, onlooker=len(self._addresses) > 2)
            self._set_state("is heard")
            while session.info.routers_zid():
                for address in self._addresses:
                    for key, message in _messages(bus, address):
                        self._take(self._endpoint, key, message)
                        for line in _lines(message):
                            self._say(line)
                time.sleep(_LOOK_S)
        self._set_state("is no longer heard; it is looked for")

    def _set_state(self, words: str) -> None:
        if words != self._state:
            self._state = words
            self._say(words)

    def _say(self, words: str) -> None:
        self._lines.put(f"{self._endpoint}  {words}")


def _checked(endpoints: Sequence[str], keys: Path) -> tuple[Keys, list[str]]:
    """The keys, and every endpoint once. Raises an AcrcError where one makes no sense."""
    for endpoint in endpoints:
        host, colon, port = endpoint.removeprefix("tls/").rpartition(":")
        if not endpoint.startswith("tls/") or not host or not colon or not port.isdecimal():
            raise wrong_value("ENDPOINT", endpoint, "like tls/192.168.1.12:7447")
        if not 0 < int(port[:6]) < 65536:
            raise wrong_value("ENDPOINT", endpoint, "one with a port from 1 to 65535")
    return load_keys(keys), list(dict.fromkeys(endpoints))


def _lines(message: Message) -> list[str]:
    """What it says, in words; nothing where it is not for people."""
    if isinstance(message, Progress):
        return [f"step {message.step}: {told(message)}"]
    if isinstance(message, Board):
        return [f"{in_seconds(note.instant):.3f} {note}" for note in message.notes]
    return []


def told(progress: Progress) -> str:
    """How a robot gets on, in words."""
    state = "stopped" if progress.finished else "paused" if progress.paused else "running"
    return (
        f"{progress.places_left} places left, {progress.reports} reported, "
        f"{', '.join((state, *map(printable, progress.held)))}"
    )
