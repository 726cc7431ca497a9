"""Serves the page and its socket on loopback: to whom knows the token, and to no other page.

What comes from a page is untrusted: bounded, checked, counted. A page that is slow misses states, and one
that takes nothing is closed; neither holds up anybody else.
"""

import asyncio
import secrets
from http import HTTPStatus
from importlib import resources
from typing import Annotated, Any, Final

import msgspec
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from deploy.control.run_link import RunLink
from deploy.control.scene import Scene

HOST: Final = "127.0.0.1"
ASK_BYTES: Final = 1024
"""No message from a page is longer."""
PAGES: Final = 8
"""Open at a time; the next one is told so, and closed."""
TOO_MANY: Final = f"{PAGES} pages of this run are open already. Close one, then reload this one."
JUNK: Final = 20
"""After so many messages that are no orders a page is closed."""
PATIENCE_S: Final = 10.0
"""A page that takes nothing for so long is closed; own choice."""


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
            write_limit=1 << 16, ping_timeout=PATIENCE_S, close_timeout=1.0, compression=None,
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
            async with asyncio.timeout(PATIENCE_S):
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
