"""Serves the page and its socket on loopback: to whom knows the token, and to no other page.

What comes from a page is untrusted: bounded, checked, counted. A page that is slow misses states, and one
that takes nothing is closed; neither holds up anybody else.
"""

import asyncio
import secrets
from collections.abc import Callable, Iterable
from http import HTTPStatus
from importlib import resources
from typing import Final

import msgspec
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from deploy.control.run_link import KEPT, OrderLines
from deploy.control.scene import Scene
from deploy.control.wire import ASK_BYTES, Ask, JunkError, MapState, OrderLine, ask

HOST: Final = "127.0.0.1"
PAGES: Final = 8
"""Open at a time; the next one is told so, and closed."""
TOO_MANY: Final = f"{PAGES} pages of this run are open already. Close one, then reload this one."
JUNK: Final = 20
"""After so many messages that are no orders a page is closed."""
PATIENCE_S: Final = 10.0
"""A page that takes nothing for so long is closed; own choice."""
_PARTS: Final = ("page.css", "drawing.js", "view.js", "panel.js", "gestures.js", "keys.js")
"""Files that the page is put together from, in this order; each has its mark in page.html."""


class OpenPage:
    """One open page."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.lines: dict[int, OrderLine] = {}
        """Lines of the list of orders that it has not been sent, by number."""
        self.wake = asyncio.Event()
        self.stale = True
        """There is a state that it has not been sent."""
        self.late = 0
        self.junk = 0

    def tell(self, lines: Iterable[OrderLine]) -> None:
        """Have lines sent; a line takes the place of what it was before, and of many the oldest drop out."""
        self.lines |= {line.number: line for line in lines}
        for number in sorted(self.lines)[:-KEPT]:
            del self.lines[number]
        self.wake.set()

    def renew(self) -> None:
        """There is a newer state."""
        self.late += self.stale
        self.stale = True
        self.wake.set()


class ControlServer:
    """The pages of one run."""

    def __init__(self, scene: Scene, lines: OrderLines, give: Callable[[Ask], None]) -> None:
        """`give` gives the run what a page asks for, and `lines` tells what becomes of it."""
        self._scene = scene
        self._lines = lines
        self._give = give
        self._token = secrets.token_urlsafe(24)
        self._nonce = secrets.token_urlsafe(12)
        self._port = 0
        self._pages: set[OpenPage] = set()
        self._newest: MapState | None = None
        """Of all pages; None: to be made."""
        self.junk = 0
        """Messages that were no orders."""

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self._port}/{self._token}/"

    async def start(self) -> Server:
        """Listen, at a port that the system chooses; to be closed by the caller."""
        server = await serve(
            self._page,
            HOST,
            0,
            process_request=self._admit,
            max_size=ASK_BYTES,
            max_queue=16,
            write_limit=1 << 16,
            ping_timeout=PATIENCE_S,
            close_timeout=1.0,
            compression=None,
            server_header=None,
        )
        self._port = next(iter(server.sockets)).getsockname()[1]
        return server

    def renew(self) -> None:
        """The scene has changed."""
        self._newest = None
        for page in self._pages:
            page.renew()

    def tell(self) -> None:
        """Tell all pages what has become of orders."""
        if fresh := self._lines.fresh():
            for page in self._pages:
                page.tell(fresh)

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page for its path; None for its socket, which becomes one; a refusal for all else."""
        here = f"{HOST}:{self._port}"
        path = request.path
        token = path.strip("/").removesuffix("/socket").encode()
        if request.headers.get_all("Host") != [here] or not secrets.compare_digest(
            token, self._token.encode()
        ):
            return _response(HTTPStatus.NOT_FOUND, b"There is no such page.\n")
        if not path.endswith("/socket"):
            text = _text("page.html")
            for part in _PARTS:
                text = text.replace(f"/* {part} */", _text(part))
            policy = (
                f"default-src 'none'; script-src 'nonce-{self._nonce}'; style-src 'nonce-{self._nonce}'; "
                f"img-src data:; connect-src ws://{here}; base-uri 'none'; form-action 'none'; "
                "frame-ancestors 'none'"
            )
            return _response(HTTPStatus.OK, text.replace("NONCE", self._nonce).encode(), policy)
        if request.headers.get_all("Origin") != [f"http://{here}"]:
            return _response(HTTPStatus.FORBIDDEN, b"Another page must not give orders here.\n")
        return None

    async def _page(self, connection: ServerConnection) -> None:
        if len(self._pages) >= PAGES:
            # Only now: of a refusal to connect a browser tells its page nothing.
            await connection.close(1013, TOO_MANY)
            return
        page = OpenPage(connection)
        page.tell(self._lines.kept())
        self._pages.add(page)
        sender = asyncio.create_task(self._send(page))
        try:
            async for data in connection:
                try:
                    wish = ask(data)
                except JunkError:
                    self.junk += 1
                    page.junk += 1
                    self._newest = None
                    page.renew()
                    if page.junk >= JUNK:
                        await connection.close(1008, "no orders")
                        return
                else:
                    self._give(wish)
        except ConnectionClosed:
            return
        finally:
            self._pages.discard(page)
            sender.cancel()

    async def _send(self, page: OpenPage) -> None:
        """The newest state, and all lines, for as long as the page takes them."""
        try:
            await self._put(page, msgspec.json.encode(self._scene.floor))
            await self._put(page, msgspec.json.encode(self._scene.past()))
            page.wake.set()
            while True:
                await page.wake.wait()
                page.wake.clear()
                while page.lines:
                    await self._put(page, msgspec.json.encode(page.lines.pop(min(page.lines))))
                if page.stale:
                    page.stale = False
                    if self._newest is None:
                        self._newest = self._scene.state(junk=self.junk)
                    state = msgspec.structs.replace(self._newest, late=page.late)
                    await self._put(page, msgspec.json.encode(state))
        except (ConnectionClosed, TimeoutError):
            page.connection.transport.abort()

    async def _put(self, page: OpenPage, data: bytes) -> None:
        async with asyncio.timeout(PATIENCE_S):
            await page.connection.send(data.decode())


def _text(file: str) -> str:
    return resources.files(__package__).joinpath(file).read_text(encoding="utf-8")


def _response(status: HTTPStatus, body: bytes, policy: str = "default-src 'none'") -> Response:
    kind = "text/html; charset=utf-8" if status is HTTPStatus.OK else "text/plain; charset=utf-8"
    headers = Headers({
        "Content-Type": kind, "Content-Length": str(len(body)), "Content-Security-Policy": policy,
        "Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff",
        "Connection": "close",
    })  # fmt: skip
    return Response(status.value, status.phrase, headers, body)
