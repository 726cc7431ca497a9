"""Takes a run's messages and gives it orders; serves the page and its socket on loopback.

Only who knows the token gets the page; no other page gives orders. What comes from a page is untrusted:
bounded, checked, counted. A page that is slow misses states, and one that takes nothing is closed.
"""

import asyncio
import secrets
import time
from collections import deque
from collections.abc import Callable
from http import HTTPStatus
from importlib import resources
from typing import Annotated, Any, Final

import msgspec
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from actors.messages import ANSWERED, CONTROL, DRIVE, FLOOR_NEWS, PROGRESS, RECEIVED, TRUTH, Answered, Control
from actors.runtime.codec import decode, encode
from actors.runtime.core import Bus, at
from actors.runtime.errors import AcrcError
from deploy.control.scene import Scene
from deploy.run import orders

HOST: Final = "127.0.0.1"
ASK_BYTES: Final = 1024
"""No message from a page is longer."""
PAGES: Final = 8
"""Open at a time; the next one is told so, and closed."""
TOO_MANY: Final = f"{PAGES} pages of this run are open already. Close one, then reload this one."
JUNK: Final = 20
"""After so many messages that are no orders a page is closed."""
SEND_TIMEOUT_S: Final = 10.0
"""A page that takes nothing for so long is closed; own choice."""
KEPT: Final = 100
"""Lines; older ones are forgotten."""
TOPICS: Final = (DRIVE, RECEIVED, FLOOR_NEWS, TRUTH, CONTROL, ANSWERED, PROGRESS)
"""In this order they are looked at: an order comes before its answer."""
LISTENS: Final = tuple(at(topic, "*" if "{id}" in topic.pattern else "") for topic in TOPICS)
WAITING: Final = 256
"""Orders that may wait for an answer of the run."""
ANSWER_TIMEOUT_S: Final = 10.0
"""After so long pages are told that the run has not said yet what becomes of an order."""


class OrderLine(msgspec.Struct, tag_field="kind", tag="said"):
    """One line of the list of orders: equal ones in a row, or those of one series; it shows the last one."""

    number: int
    order: str
    times: int = 0
    """How many orders it stands for; of them, how many wait for an answer, and how many were refused."""
    waiting: int = 0
    refused: int = 0
    refusal: str = ""
    version: int = 0
    """Grows with each change of any line."""


class RunLink:
    """Keeps a scene up with a run; `looks` rather loses messages than holds anybody up."""

    def __init__(
        self, scene: Scene, looks: Bus, speaks: Bus, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._scene, self._looks, self._speaks, self._clock = scene, looks, speaks, clock
        self.lines: deque[OrderLine] = deque(maxlen=KEPT)
        self.version = self._begun = self._series = 0
        self._waiting: dict[str, tuple[OrderLine, float]] = {}
        """By ticket: the line, and since when."""

    def give(self, words: str, series: int = 0) -> None:
        """Give the run an order, as typed behind `acrc order RUN`; those of a series, not 0, are one line."""
        line = self.lines[-1] if self.lines else None
        if line is None or not (words == line.order or (series and series == self._series)):
            self._begun += 1
            line = OrderLine(self._begun, words)
            self.lines.append(line)
        self._series, line.order, line.times = series, words, line.times + 1
        self._change(line, waiting=1)
        try:
            verb, *rest = words.split() or [""]
            order = orders.parse(verb, rest)
            if self._scene.over or len(self._waiting) >= WAITING:
                raise AcrcError("the run is over" if self._scene.over else "too many orders wait already")
        except AcrcError as error:
            self._change(line, waiting=-1, refusal=str(error))
            return
        ticket = secrets.token_hex(8)
        self._waiting[ticket] = line, self._clock()
        self._speaks.publish(CONTROL.key(), encode(Control(0, (order,), ticket), CONTROL.key()))

    def look(self) -> None:
        """Take in all that has come; of what transceivers received, the newest message of each."""
        for address in LISTENS:
            come = []
            while (delivery := self._looks.poll(address.topic)) is not None:
                come.append(delivery)
            for one in {one.key: one for one in come}.values() if address.topic is RECEIVED else come:
                message = decode(one.topic, one.key, one.payload)
                self._scene.take(one.key, message)
                if isinstance(message, Answered):
                    self._answer(message.ticket, "; ".join(message.refusals))
        late = [one for one, (_, since) in self._waiting.items() if self._clock() - since > ANSWER_TIMEOUT_S]
        for ticket in late:
            self._answer(ticket, "the run has not said yet; it heeds the order at its next step")

    def _answer(self, ticket: str, refusal: str) -> None:
        if ticket in self._waiting:
            self._change(self._waiting.pop(ticket)[0], waiting=-1, refusal=refusal)

    def _change(self, line: OrderLine, *, waiting: int, refusal: str = "") -> None:
        self.version += 1
        line.version, line.waiting = self.version, line.waiting + waiting
        line.refused, line.refusal = line.refused + bool(refusal), refusal or line.refusal


class Ask(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An order that somebody gives on the page."""

    series: Annotated[int, msgspec.Meta(ge=0, lt=1 << 31)]
    """Orders of one drag, or of keys pressed in a row, have the same, chosen by the page; 0: it is alone."""
    order: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]


def ask(data: str | bytes) -> Ask | None:
    """The order in a message from a page; None if it is none."""
    try:
        return msgspec.json.decode(data, type=Ask) if len(data) <= ASK_BYTES else None
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return None


class ControlServer:
    """The pages of one run."""

    def __init__(self, scene: Scene, link: RunLink) -> None:
        self._scene, self._link = scene, link
        self._token, self._nonce = secrets.token_urlsafe(24), secrets.token_urlsafe(12)
        self._host, self._told = "", 0
        self._pages: set[asyncio.Event] = set()
        """Of each open page, what wakes it."""
        self._version, self._newest = 0, (-1, dict[str, Any]())
        """Of the scene, and the last state that was made, with its version."""
        self.junk = 0
        """Messages that were no orders."""

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self._host}/{self._token}/"

    async def start(self) -> Server:
        """Listen, at a port that the system chooses; to be closed by the caller."""
        server = await serve(
            self._page, HOST, 0, process_request=self._admit, max_size=ASK_BYTES, max_queue=16,
            write_limit=1 << 16, ping_timeout=SEND_TIMEOUT_S, close_timeout=1.0, compression=None,
            server_header=None,
        )  # fmt: skip
        self._host = f"{HOST}:{next(iter(server.sockets)).getsockname()[1]}"
        return server

    def renew(self) -> None:
        """Have all pages sent what is new of the scene, and of orders."""
        if self._scene.changed or self._link.version != self._told:
            self._version += self._scene.changed
            self._scene.changed, self._told = False, self._link.version
            for wake in self._pages:
                wake.set()

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page for its path; None for its socket, which becomes one; a refusal for all else."""
        token = request.path.strip("/").removesuffix("/socket").encode()
        is_known = secrets.compare_digest(token, self._token.encode())
        if request.headers.get_all("Host") != [self._host] or not is_known:
            return _response(HTTPStatus.NOT_FOUND, "There is no such page.\n")
        if request.path.endswith("/socket"):
            if request.headers.get_all("Origin") == [f"http://{self._host}"]:
                return None
            return _response(HTTPStatus.FORBIDDEN, "Another page must not give orders here.\n")
        text = _text("page.html")
        for part in ("page.css", "map.js", "page.js"):
            text = text.replace(f"/* {part} */", _text(part))
        policy = (
            f"default-src 'none'; script-src 'nonce-{self._nonce}'; style-src 'nonce-{self._nonce}'; "
            f"img-src data:; connect-src ws://{self._host}; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
        )
        return _response(HTTPStatus.OK, text.replace("NONCE", self._nonce), policy)

    async def _page(self, connection: ServerConnection) -> None:
        if len(self._pages) >= PAGES:
            # Only now: of a refusal to connect a browser tells its page nothing.
            await connection.close(1013, TOO_MANY)
            return
        wake, junk = asyncio.Event(), 0
        self._pages.add(wake)
        sender = asyncio.create_task(self._send(connection, wake))
        try:
            async for data in connection:
                if (wish := ask(data)) is not None:
                    self._link.give(wish.order, wish.series)
                    continue
                self.junk, junk, self._scene.changed = self.junk + 1, junk + 1, True
                if junk >= JUNK:
                    await connection.close(1008, "no orders")
                    return
        except ConnectionClosed:
            return
        finally:
            self._pages.discard(wake)
            sender.cancel()

    async def _send(self, connection: ServerConnection, wake: asyncio.Event) -> None:
        """The newest state, and all lines, for as long as the page takes them; `late`: states left out."""

        async def put(told: object) -> None:
            async with asyncio.timeout(SEND_TIMEOUT_S):
                await connection.send(msgspec.json.encode(told).decode())

        sent, seen, late = 0, -1, 0
        try:
            await put(self._scene.floor)
            await put(self._scene.past())
            wake.set()
            while await wake.wait():
                wake.clear()
                lines, sent = [one for one in self._link.lines if one.version > sent], self._link.version
                for line in lines:
                    await put(line)
                if seen != self._version:
                    late += self._version - seen - 1 if seen >= 0 else 0
                    seen = self._version
                    if self._newest[0] != seen:
                        self._newest = seen, self._scene.state()
                    await put(self._newest[1] | {"late": late, "junk": self.junk})
        except (ConnectionClosed, TimeoutError):
            connection.transport.abort()


def _text(file: str) -> str:
    return resources.files(__package__).joinpath(file).read_text(encoding="utf-8")


def _response(status: HTTPStatus, text: str, policy: str = "default-src 'none'") -> Response:
    kind, body = "text/html" if status is HTTPStatus.OK else "text/plain", text.encode()
    headers = Headers({
        "Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(body)),
        "Content-Security-Policy": policy, "Cache-Control": "no-store", "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff", "Connection": "close",
    })  # fmt: skip
    return Response(status.value, status.phrase, headers, body)
