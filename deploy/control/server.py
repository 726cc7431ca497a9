"""Server of the map page on loopback: sends the run's state to pages and their orders to the run.

The page's address contains a token, and connections from other origins are rejected. Messages from a page
are untrusted: their size is limited, their content checked and invalid ones counted. A slow page skips
states; one that reads nothing is closed.
"""

import asyncio
import secrets
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from importlib import resources
from typing import Any, Final

import msgspec
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from actors.items import ITEM_LIMIT
from actors.messages import (
    ANSWERED,
    CONTROL,
    DRIVE,
    FLOOR_NEWS,
    PROGRESS,
    RECEIVED,
    TASK_NEWS,
    TRUTH,
    Control,
    OrderOutcomes,
)
from actors.runtime.codec import decode, encode
from actors.runtime.core import Bus, at
from actors.runtime.errors import AcrcError
from deploy.control.scene import MAX_PENDING_ORDERS, Scene
from deploy.run import order_bus

HOST: Final = "127.0.0.1"
MAX_ORDER_LENGTH: Final = ITEM_LIMIT + 200
"""Maximum length of an order from a page, in the syntax of `acrc order RUN`."""
MAX_PAGES: Final = 8
"""Maximum number of open pages; further ones are closed with an error."""
TOO_MANY_PAGES: Final = f"{MAX_PAGES} pages of this run are open already. Close one, then reload this one."
MAX_INVALID_MESSAGES: Final = 20
"""Number of invalid messages after which a page is closed."""
SEND_TIMEOUT_S: Final = 10.0
"""Time after which a page that reads nothing is closed, s; our choice."""
MAX_LINES: Final = 100
"""Maximum length of the list of orders; older ones are dropped."""
TOPICS: Final = (DRIVE, RECEIVED, FLOOR_NEWS, TASK_NEWS, TRUTH, CONTROL, ANSWERED, PROGRESS)
"""Topics in polling order: an order precedes its answer."""
ADDRESSES: Final = tuple(at(topic, "*" if "{id}" in topic.pattern else "") for topic in TOPICS)
ANSWER_TIMEOUT_S: Final = 10.0
"""Time after which the list of orders shows a missing answer, s."""
POLICY: Final = (
    "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src data:; "
    "connect-src ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
UNANSWERED: Final = "no answer yet; the run executes the order at its next step"


class OrderLine(msgspec.Struct, tag_field="kind", tag="order"):
    """Line of the list of orders: the last of equal orders, or of moves of one robot, in a row."""

    number: int
    order: str
    times: int = 0
    """Number of orders in this line; `waiting`: those without an answer; `refused`: those refused."""
    waiting: int = 0
    refused: int = 0
    refusal: str = ""
    version: int = 0
    """Increases with each change of any line."""


class RunLink:
    """Link between a scene and a run.

    `messages`: a bus that drops messages rather than delaying the run.
    """

    def __init__(
        self, scene: Scene, messages: Bus, orders: Bus, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._scene, self._messages, self._orders, self._clock = scene, messages, orders, clock
        self.lines: deque[OrderLine] = deque(maxlen=MAX_LINES)
        self.version = 0
        self._unanswered: dict[str, tuple[OrderLine, float]] = {}
        """Line and time, s, of each order without an answer, by ticket."""

    def send_order(self, words: str) -> None:
        """Send an order to the run, in the syntax of `acrc order RUN`."""
        verb, *rest = words.split() or [""]
        line = self.lines[-1] if self.lines else OrderLine(0, "")
        if words != line.order and (verb != "move" or line.order.split()[:2] != [verb, *rest[:1]]):
            line = OrderLine(line.number + 1, words)
            self.lines.append(line)
        line.order, line.times = words, line.times + 1
        self._update_line(line, waiting=1)
        try:
            order = order_bus.parse(verb, rest)
            if self._scene.over or len(self._unanswered) >= MAX_PENDING_ORDERS:
                raise AcrcError("the run has ended" if self._scene.over else "too many unanswered orders")
        except AcrcError as error:
            self._update_line(line, waiting=-1, refusal=str(error))
            return
        ticket = secrets.token_hex(8)
        self._unanswered[ticket] = line, self._clock()
        self._orders.publish(CONTROL.key(), encode(Control(0, (order,), ticket), CONTROL.key()))

    def poll(self) -> None:
        """Process all messages; of `RadioEvents` only the newest per transceiver."""
        for address in ADDRESSES:
            received = list(iter(partial(self._messages.poll, address.topic), None))
            for one in {one.key: one for one in received}.values() if address.topic is RECEIVED else received:
                message = decode(one.topic, one.key, one.payload)
                self._scene.take(one.key, message)
                if isinstance(message, OrderOutcomes):
                    self._settle_order(message.ticket, "; ".join(message.refusals))
        oldest = self._clock() - ANSWER_TIMEOUT_S
        for ticket in [ticket for ticket, (_, since) in self._unanswered.items() if since < oldest]:
            self._settle_order(ticket, UNANSWERED)

    def _settle_order(self, ticket: str, refusal: str) -> None:
        if ticket in self._unanswered:
            self._update_line(self._unanswered.pop(ticket)[0], waiting=-1, refusal=refusal)

    def _update_line(self, line: OrderLine, *, waiting: int, refusal: str = "") -> None:
        self.version, self._scene.changed = self.version + 1, True
        line.version, line.waiting = self.version, line.waiting + waiting
        line.refused, line.refusal = line.refused + bool(refusal), refusal or line.refusal


class ControlServer:
    """Server of the pages of one run."""

    def __init__(self, scene: Scene, link: RunLink) -> None:
        self._scene, self._link = scene, link
        self._token, self._nonce, self._host = secrets.token_urlsafe(24), secrets.token_urlsafe(12), ""
        self._pages: set[asyncio.Event] = set()
        """Events that wake the senders of the open pages."""
        self._version, self._state = 0, dict[str, Any]()
        """Number and content of the last state."""
        self.invalid = 0
        """Number of invalid messages."""

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://{self._host}/{self._token}/"

    async def start(self) -> Server:
        """Listen at a free port; the caller closes the server."""
        server = await serve(
            self._page, HOST, 0, process_request=self._respond, max_size=MAX_ORDER_LENGTH, max_queue=16,
            write_limit=1 << 16, ping_timeout=SEND_TIMEOUT_S, close_timeout=1.0, compression=None,
            server_header=None,
        )  # fmt: skip
        self._host = f"{HOST}:{next(iter(server.sockets)).getsockname()[1]}"
        return server

    def send_changes(self) -> None:
        """Send changes to all pages."""
        if self._scene.changed and self._pages:
            self._scene.changed, self._version, self._state = False, self._version + 1, self._scene.state()
            for wake in self._pages:
                wake.set()

    def _respond(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page, or an error; None for the page's WebSocket."""
        token = request.path.strip("/").removesuffix("/socket").encode()
        is_known = secrets.compare_digest(token, self._token.encode())
        policy, content_type = "default-src 'none'", "text/plain"
        if request.headers.get_all("Host") != [self._host] or not is_known:
            response = connection.respond(HTTPStatus.NOT_FOUND, "Not found.\n")
        elif request.path.endswith("/socket"):
            if request.headers.get_all("Origin") == [f"http://{self._host}"]:
                return None
            response = connection.respond(HTTPStatus.FORBIDDEN, "Orders require the run's page.\n")
        else:
            folder = resources.files(__package__)
            text = folder.joinpath("page.html").read_text(encoding="utf-8")
            for part in ("page.css", "map.js", "page.js"):
                text = text.replace(f"/* {part} */", folder.joinpath(part).read_text(encoding="utf-8"))
            response = connection.respond(HTTPStatus.OK, text.replace("NONCE", self._nonce))
            policy, content_type = POLICY.format(nonce=self._nonce, host=self._host), "text/html"
        del response.headers["Content-Type"]
        response.headers.update({
            "Content-Type": f"{content_type}; charset=utf-8", "Content-Security-Policy": policy,
            "Cache-Control": "no-store", "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        })  # fmt: skip
        return response

    async def _page(self, connection: ServerConnection) -> None:
        if len(self._pages) >= MAX_PAGES:  # only after the handshake can a browser show the reason
            await connection.close(1013, TOO_MANY_PAGES)
            return
        wake, invalid = asyncio.Event(), 0
        self._pages.add(wake)
        sender = asyncio.create_task(self._send(connection, wake))
        try:
            async for data in connection:
                if isinstance(data, str) and data:
                    self._link.send_order(data)
                    continue
                self.invalid, invalid, self._scene.changed = self.invalid + 1, invalid + 1, True
                if invalid >= MAX_INVALID_MESSAGES:
                    await connection.close(1008, "too many invalid messages")
                    return
        except ConnectionClosed:
            return
        finally:
            self._pages.discard(wake)
            sender.cancel()

    async def _send(self, connection: ServerConnection, wake: asyncio.Event) -> None:
        """Send states and changed lines while the page is open; count skipped states."""

        async def send_json(message: object) -> None:
            async with asyncio.timeout(SEND_TIMEOUT_S):
                await connection.send(msgspec.json.encode(message).decode())

        lines_sent, sent, skipped = 0, 0, 0
        try:
            await send_json(self._scene.floor())
            self._scene.changed = True
            self.send_changes()
            while await wake.wait():
                wake.clear()
                lines = [one for one in self._link.lines if one.version > lines_sent]
                lines_sent = self._link.version
                if sent != self._version:
                    skipped, sent = skipped + (self._version - sent - 1 if sent else 0), self._version
                    await send_json(self._state | {"late": skipped, "junk": self.invalid})
                for line in lines:
                    await send_json(line)
        except (ConnectionClosed, TimeoutError):
            connection.transport.abort()
