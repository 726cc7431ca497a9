"""The page's server without a browser: who gets in, and what becomes of those who send junk or are slow."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY
from actors.messages import ANSWERED, CONTROL, Answered, Control, Drive, Jam, Progress, RobotTruth, Truth
from actors.orders import CloseDoor, Give, Move, Obstacle, OpenDoor, Speed, Wall
from actors.runtime.bus_interface import Delivery
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from actors.task.words import PlaceReport
from actors.topic import Message, Topic
from actors.world.world_setup import BodySetup, TimedOrder, WorldSetup
from deploy.control import scene as scenes
from deploy.control.wire import ASK_BYTES, Ask, JunkError, MapRobot, OrderAnswer, Place, ask

server = pytest.importorskip("deploy.control.server", reason="websockets comes with `./acrc run --control`")
run_link = pytest.importorskip("deploy.control.run_link")
client = pytest.importorskip("websockets.asyncio.client")
exceptions = pytest.importorskip("websockets.exceptions")

TRUTH_OF_R1 = RobotTruth("r1", 12.0, 13.0, 0.5, 0, 0, 0, stepping=True, powered=True, transmits=0)


class Mesh:
    """A bus on which the test is the run."""

    def __init__(self) -> None:
        self.given: list[Control] = []
        self.says: dict[str, list[bytes]] = {}

    def publish(self, key: str, payload: bytes) -> None:
        told = decode(at(CONTROL).topic, key, payload)
        assert isinstance(told, Control)
        self.given.append(told)

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        waiting = self.says.get(topic.pattern)
        return Delivery(topic, topic.pattern, waiting.pop(0)) if waiting else None


def scene(*events: TimedOrder) -> scenes.Scene:
    robots = (BodySetup("r1", "turtlebot2", None, "exact", (12.0, 13.0, 0.0), ((13.0, 13.0), (14.0, 13.0))),)
    setup = WorldSetup(str(_map()), 1, 100_000, 1_000_000, robots, events)
    return scenes.Scene(setup, load_map(_map()), 2.0)


def _map() -> Path:
    return next(iter(sorted((REPOSITORY / "maps").rglob("*.yaml"))))


Trial = Callable[[Any, Mesh, Any], Awaitable[None]]


def serve(trial: Trial) -> None:
    """Let the trial talk to a server of a scene whose run is a Mesh."""

    async def play() -> None:
        mesh, stage = Mesh(), scene()
        link = run_link.RunLink(stage, mesh, mesh)
        pages = server.ControlServer(stage, link.give)
        async with await pages.start():
            await trial(pages, mesh, link)

    asyncio.run(play())


def socket(pages: Any, *, url: str | None = None, origin: str | None = "") -> Any:
    address = (url or pages.url).replace("http", "ws") + "socket"
    own = pages.url.rsplit("/", 2)[0]
    return client.connect(address, origin=own if origin == "" else origin, max_queue=1)


async def heard(connection: Any, kind: str) -> dict[str, Any]:
    while True:
        told: dict[str, Any] = json.loads(await asyncio.wait_for(connection.recv(), 5))
        if told["kind"] == kind:
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
            await page.send('{"id": 7, "order": "move r1 1 2 0"}')
            await page.send('{"id": 8, "order": "dance"}')
            told = await heard(page, "said")
            assert told["id"] == 8 and told["refusal"].startswith("VERB: dance; must be one of")
            (given,) = mesh.given
            assert given.orders == (Move("r1", 1.0, 2.0, 0.0),)
            answer = encode(Answered(0, given.ticket, ("at 3 s: no",)), ANSWERED.key())
            mesh.says[ANSWERED.pattern] = [answer]
            link.look()
            assert await heard(page, "said") == {
                "kind": "said", "id": 7, "order": "move r1 1 2 0", "refusal": "at 3 s: no",
            }  # fmt: skip

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
    ["", "[]", "{}", "x" * 2000, '{"id": -1, "order": "pause"}', '{"id": 1, "order": ""}', "[" * 900,
     '{"id": 1, "order": "pause", "more": 1}', '{"id": "1", "order": "pause"}', b"\xff\xfe"],
)  # fmt: skip
def test_what_is_no_order(data: str | bytes) -> None:
    with pytest.raises(JunkError):
        ask(data)


def test_a_page_is_told_when_the_run_says_nothing() -> None:
    now, stage, mesh = [0.0], scene(), Mesh()
    link = run_link.RunLink(stage, mesh, mesh, lambda: now[0])
    told: list[OrderAnswer] = []

    class Listener:
        tell = staticmethod(told.append)

    link.give(Listener(), Ask(1, "pause"))
    now[0] = run_link.PATIENCE_S + 1
    link.look()
    assert [one.refusal for one in told] == ["the run has not said yet; it heeds the order at its next step"]


def test_the_scene_follows_messages_and_orders_that_were_carried_out() -> None:
    stage = scene(TimedOrder(200_000, Obstacle(5.0, 5.0, 0.2)))
    stage.take(Truth(0, 0, (TRUTH_OF_R1,), (Jam(1.0, 1.0, 3.0, 250_000),)))
    stage.take(Drive(0, 0.0, 0.0, 0.0, 0, (PlaceReport("r1", 1, 0), PlaceReport("r9", 5, 0))))
    stage.take(Control(0, (Wall(1.0, 1.0, 2.0, 1.0), Move("r1", 3.0, 4.0, 0.0), Speed(0.5)), "a"))
    stage.take(Control(0, (Wall(9.0, 9.0, 9.0, 9.0), Speed(7.0)), "b"))
    assert stage.state(junk=0).speed == 2.0
    stage.take(Answered(1, "a", ()))
    stage.take(Answered(1, "b", ("no",)))
    stage.take(Progress(1, 100_000, 1, 1, finished=False, paused=True))
    state = stage.state(junk=3)
    assert state.robots == (MapRobot("r1", 3.0, 4.0, 0.0, "driving"),)
    assert (state.walls, state.done, state.paused, state.junk) == (((1.0, 1.0, 2.0, 1.0),), (1,), True, 3)
    assert state.speed == 0.5
    assert (state.jammers, state.obstacles) == (((1.0, 1.0, 3.0),), ())
    stage.take(Truth(3, 300_000, (TRUTH_OF_R1,)))
    state = stage.state(junk=3)
    assert (state.jammers, state.obstacles, state.missed) == ((), ((5.0, 5.0, 0.2),), 2)
    assert (state.paused, state.t, state.over) == (False, 0.3, False)
    stage.take(Control(0, (Give("r1", ((7.0, 7.0),)), CloseDoor(1.0, 1.0), CloseDoor(5.0, 5.0)), "c"))
    stage.take(Control(0, (OpenDoor(4.9, 5.0),), "d"))
    for ticket in ("c", "d"):
        stage.take(Answered(3, ticket, ()))
    stage.take(Drive(3, 0.0, 0.0, 0.0, 0, (PlaceReport("r1", 2, 0),)))
    state = stage.state(junk=3)
    assert (state.given, state.done, state.closed) == ((Place("r1", 7.0, 7.0),), (1, 2), ((1.0, 1.0),))
    stage.take(Truth(4, 400_000, (), halt=True))
    assert stage.state(junk=0).over
