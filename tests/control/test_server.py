"""The page's server without a browser: who gets in, and what becomes of those who send junk or are slow."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from actors.messages import ANSWERED, Answered, Truth
from actors.orders import Move
from actors.runtime.codec import encode
from deploy.control.run_link import OrderLines
from deploy.control.wire import ASK_BYTES, JunkError, ask
from tests.control.stage import TRUTH_OF_R1, Mesh, scene, truth_of

server = pytest.importorskip("deploy.control.server", reason="websockets comes with `./acrc run --control`")
run_link = pytest.importorskip("deploy.control.run_link")
client = pytest.importorskip("websockets.asyncio.client")
exceptions = pytest.importorskip("websockets.exceptions")


Trial = Callable[[Any, Mesh, Any], Awaitable[None]]


def serve(trial: Trial) -> None:
    """Let the trial talk to a server of a scene whose run is a Mesh."""

    async def play() -> None:
        mesh, stage, lines = Mesh(), scene(), OrderLines()
        link = run_link.RunLink(stage, lines, mesh, mesh)
        pages = server.ControlServer(stage, lines, link.give)
        async with await pages.start():
            await trial(pages, mesh, link)

    asyncio.run(play())


def socket(pages: Any, *, url: str | None = None, origin: str | None = "") -> Any:
    address = (url or pages.url).replace("http", "ws") + "socket"
    own = pages.url.rsplit("/", 2)[0]
    return client.connect(address, origin=own if origin == "" else origin, max_queue=1, close_timeout=0.1)


async def heard(connection: Any, kind: str) -> dict[str, Any]:
    while True:
        told: dict[str, Any] = json.loads(await asyncio.wait_for(connection.recv(), 5))
        if told["kind"] == kind:
            return told


async def told_line(pages: Any, connection: Any, number: int) -> dict[str, Any]:
    """A line of the list of orders that the run has answered."""
    while True:
        await asyncio.sleep(0.01)
        pages.tell()
        told = await heard(connection, "said")
        if told["number"] == number and not told["waiting"]:
            return told


def test_only_who_knows_the_token_and_comes_from_the_page_gets_in() -> None:
    async def trial(pages: Any, mesh: Mesh, link: Any) -> None:
        token = pages.url.rsplit("/", 2)[1]
        assert len(token) == 32
        wrong = pages.url.replace(token, "A" * 32)
        for url, origin, status in (
            (wrong, "", 404),
            (pages.url, None, 403),
            (pages.url, "http://example.org", 403),
            (pages.url, "null", 403),
        ):
            with pytest.raises(exceptions.InvalidStatus) as refused:
                await socket(pages, url=url, origin=origin)
            assert refused.value.response.status_code == status
        for path, host, status in (
            (f"/{token}/", None, 200),
            (f"/{'A' * 32}/", None, 404),
            ("/", None, 404),
            (f"/{token}/", "example.org", 404),
        ):
            assert await _status(pages, path, host) == status

    serve(trial)


async def _status(pages: Any, path: str, host: str | None) -> int:
    port = int(pages.url.split(":")[2].split("/")[0])
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: {host or f'127.0.0.1:{port}'}\r\n\r\n".encode())
    line = await reader.readline()
    writer.close()
    return int(line.split()[1])


def test_an_order_of_a_page_is_given_to_the_run_and_answered() -> None:
    async def trial(pages: Any, mesh: Mesh, link: Any) -> None:
        async with socket(pages) as page:
            assert (await heard(page, "floor"))["places"] == [["r1", 13.0, 13.0], ["r1", 14.0, 13.0]]
            await page.send('{"series": 0, "order": "move r1 1 2 0"}')
            await page.send('{"series": 0, "order": "dance"}')
            told = await told_line(pages, page, 2)
            assert told["refused"] == 1 and told["refusal"].startswith("VERB: dance; must be one of")
            (given,) = mesh.given
            assert given.orders == (Move("r1", 1.0, 2.0, 0.0),)
            answer = encode(Answered(0, given.ticket, ("at 3 s: no",)), ANSWERED.key())
            mesh.says[ANSWERED.pattern] = [answer]
            link.look()
            refused = {
                "kind": "said", "number": 1, "order": "move r1 1 2 0", "times": 1, "waiting": 0, "refused": 1,
                "refusal": "at 3 s: no",
            }  # fmt: skip
            assert await told_line(pages, page, 1) == refused
            async with socket(pages) as later:
                assert await heard(later, "said") == refused
                assert (await heard(later, "said"))["order"] == "dance"

    serve(trial)


def test_junk_is_counted_and_ends_the_page_that_sends_it() -> None:
    async def trial(pages: Any, mesh: Mesh, link: Any) -> None:
        async with socket(pages) as other, socket(pages) as page:
            for _ in range(server.JUNK):
                await page.send(b"\xff\x00[[[")
            with pytest.raises(exceptions.ConnectionClosed):
                while True:
                    await asyncio.wait_for(page.recv(), 5)
            assert (pages.junk, mesh.given) == (server.JUNK, [])
            async with socket(pages) as large:
                await large.send("x" * (ASK_BYTES + 1))
                with pytest.raises(exceptions.ConnectionClosed) as closed:
                    while True:
                        await asyncio.wait_for(large.recv(), 5)
                assert closed.value.rcvd.code == 1009
            pages.renew()
            await heard(other, "floor")
            while (await heard(other, "state"))["junk"] != server.JUNK:
                pages.renew()

    serve(trial)


def test_a_page_that_takes_nothing_misses_states_and_holds_nobody_up() -> None:
    async def trial(pages: Any, mesh: Mesh, link: Any) -> None:
        async with socket(pages) as slow, socket(pages) as quick:
            slow.transport.pause_reading()
            await heard(quick, "floor")
            for number in range(200):
                await asyncio.sleep(0)
                link._scene.take(Truth(number, number * 100_000, (TRUTH_OF_R1,)))
                pages.renew()
                while (await heard(quick, "state"))["step"] != number:
                    pass
            slow.transport.abort()

    serve(trial)


def test_states_that_come_faster_than_a_page_takes_them_are_counted() -> None:
    async def trial(pages: Any, mesh: Mesh, link: Any) -> None:
        async with socket(pages) as page:
            await heard(page, "state")
            for _ in range(10):
                pages.renew()
            assert (await heard(page, "state"))["late"] == 9

    serve(trial)


@pytest.mark.parametrize(
    "data",
    ["", "[]", "{}", "x" * 2000, '{"series": -1, "order": "pause"}', '{"series": 1, "order": ""}', "[" * 900,
     '{"series": 1, "order": "pause", "more": 1}', '{"series": "1", "order": "pause"}', b"\xff\xfe"],
)  # fmt: skip
def test_what_is_no_order(data: str | bytes) -> None:
    with pytest.raises(JunkError):
        ask(data)


def test_the_ninth_page_is_told_why_it_is_closed() -> None:
    async def trial(pages: Any, mesh: Mesh, link: Any) -> None:
        opened = [await socket(pages) for _ in range(server.PAGES)]
        async with socket(pages) as ninth:
            with pytest.raises(exceptions.ConnectionClosed) as closed:
                await asyncio.wait_for(ninth.recv(), 5)
            told = closed.value.rcvd
            assert (told.code, told.reason) == (
                1013, "8 pages of this run are open already. Close one, then reload this one.",
            )  # fmt: skip
        await opened.pop().close()
        async with socket(pages) as next_one:
            await heard(next_one, "floor")
        for page in opened:
            await page.close()

    serve(trial)


def test_a_page_that_comes_late_is_told_the_trails() -> None:
    async def trial(pages: Any, mesh: Mesh, link: Any) -> None:
        for number in range(300):
            link._scene.take(Truth(number, number * 100_000, (truth_of("r1", 12 + number / 100, 13.0),)))
        async with socket(pages) as page:
            trail = (await heard(page, "past"))["trails"]["r1"]
        assert len(trail) == 41 and trail[0] == [9.5, 12.95, 13.0] and trail[-1] == [29.5, 14.95, 13.0]

    serve(trial)
