"""The page's server and what it sends of a run, without a browser."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from functools import cache
from typing import Any

import pytest

from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY
from actors.messages import (
    ANSWERED,
    CONTROL,
    Answered,
    Control,
    Drive,
    Jam,
    Progress,
    RobotTruth,
    Truth,
)
from actors.observer.glyphs import contrast
from actors.orders import CloseDoor, Give, Move, Obstacle, OpenDoor, Speed, Wall
from actors.runtime.codec import decode, encode
from actors.runtime.core import Delivery, at
from actors.task.task import PlaceKey, PlaceReport
from actors.topic import Message, Topic
from actors.world.world_setup import BodySetup, TimedOrder, WorldSetup
from deploy.control import page_floor
from deploy.control import scene as scenes
from deploy.control.page_floor import PageFloor
from deploy.control.run_link import KEPT, PATIENCE_S, OrderLines, RunLink
from deploy.control.wire import ASK_BYTES, Ask, JunkError, MapRobot, OrderLine, Place, ask

server = pytest.importorskip("deploy.control.server", reason="websockets comes with `./acrc run --control`")
client = pytest.importorskip("websockets.asyncio.client")
exceptions = pytest.importorskip("websockets.exceptions")


def truth_of(robot: str, x: float, y: float, *, stepping: bool = True, powered: bool = True) -> RobotTruth:
    return RobotTruth(robot, x, y, 0.5, 0, 0, 0, stepping=stepping, powered=powered, transmits=0)


TRUTH_OF_R1 = truth_of("r1", 12.0, 13.0)
MAP = REPOSITORY / "maps" / "corridor.yaml"


class Mesh:
    """A bus on which the test is the run."""

    def __init__(self) -> None:
        self.given: list[Control] = []
        self.says: dict[str, list[bytes]] = {}

    def publish(self, key: str, payload: bytes) -> None:
        told = decode(at(CONTROL).topic, key, payload)
        assert isinstance(told, Control)
        self.given.append(told)

    def receive(self, topic: Topic[Message]) -> Delivery:
        raise NotImplementedError

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        waiting = self.says.get(topic.pattern)
        return Delivery(topic, topic.key("r2"), waiting.pop(0)) if waiting else None


@cache
def floor() -> PageFloor:
    return PageFloor(world(), load_map(MAP))


def world(*events: TimedOrder) -> WorldSetup:
    places = {"r1": ((13.0, 13.0), (14.0, 13.0)), "r2": (), "r3": ()}
    start = (12.0, 13.0, 0.0)
    robots = [
        BodySetup(id=robot, model="turtlebot2", sensor=None, odometry="exact", start=start, places=own)
        for robot, own in places.items()
    ]
    return WorldSetup(str(MAP), 1, 100_000, 1_000_000, tuple(robots), events)


def scene(*events: TimedOrder) -> scenes.Scene:
    return scenes.Scene(world(*events), floor(), 2.0, {1: "r1", 2: "r2", 3: "r3"})


def test_the_scene_follows_messages_and_orders_that_were_carried_out() -> None:
    stage = scene(TimedOrder(200_000, Obstacle(5.0, 5.0, 0.2)))
    first, *_, last = stage.floor.doors
    stage.take(Truth(0, 0, (TRUTH_OF_R1,), (Jam(1.0, 1.0, 3.0, 250_000),)))
    stage.take(Drive(0, 0.0, 0.0, 0.0, 0, (PlaceReport("r1", 1, 0), PlaceReport("r9", 5, 0))), "r1")
    stage.take(Control(0, (Wall(1.0, 1.0, 2.0, 1.0), Move("r1", 3.0, 4.0, 0.0), Speed(0.5)), "a"))
    stage.take(Control(0, (Wall(9.0, 9.0, 9.0, 9.0), Speed(7.0)), "b"))
    assert stage.state(junk=0).speed == 2.0
    stage.take(Answered(1, "a", ()))
    stage.take(Answered(1, "b", ("no",)))
    stage.take(Progress(1, 100_000, 1, 1, finished=False, paused=True))
    state = stage.state(junk=3)
    assert state.robots[0] == MapRobot("r1", 3.0, 4.0, 0.0, "driving", (13.0, 13.0))
    assert (state.walls, state.done, state.paused, state.junk) == (((1.0, 1.0, 2.0, 1.0),), (1,), True, 3)
    assert state.speed == 0.5
    assert (state.jammers, state.obstacles) == (((1.0, 1.0, 3.0, 0.25),), ())
    stage.take(Truth(3, 300_000, (TRUTH_OF_R1,)))
    state = stage.state(junk=3)
    assert (state.jammers, state.obstacles, state.missed) == ((), ((5.0, 5.0, 0.2),), 2)
    assert (state.paused, state.t, state.over) == (False, 0.3, False)
    near = (last[0] + 0.3, last[1])
    stage.take(Control(0, (Give("r1", ((7.0, 7.0),)), CloseDoor(*first[:2]), CloseDoor(*near)), "c"))
    stage.take(Answered(3, "c", ()))
    assert stage.state(junk=0).closed == (0, len(stage.floor.doors) - 1)
    stage.take(Control(0, (OpenDoor(*last[:2]), OpenDoor(13.0, 13.0)), "d"))
    stage.take(Answered(3, "d", ()))
    stage.take(Drive(3, 0.0, 0.0, 0.0, 0, (PlaceReport("r1", 2, 0),), (), (PlaceKey("r1", 2),)), "r1")
    state = stage.state(junk=3)
    assert (state.given, state.done, state.closed) == ((Place("r1", 7.0, 7.0),), (1, 2), (0,))
    assert state.robots[0].destination == (7.0, 7.0)
    stage.take(Truth(4, 400_000, (), halt=True))
    assert stage.state(junk=0).over


def test_who_stands_and_who_is_blocked() -> None:
    stage = scene()

    def states(second: int, *robots: RobotTruth) -> list[tuple[str, str]]:
        stage.take(Truth(second * 10, second * 1_000_000, robots))
        return [(one.state, one.blocker) for one in stage.state(junk=0).robots]

    apart = truth_of("r2", 20.0, 13.0), truth_of("r3", 22.0, 13.0, stepping=False)
    for second in range(3):
        assert states(second, TRUTH_OF_R1, *apart) == [("driving", ""), ("driving", ""), ("frozen", "")]
    assert states(3, TRUTH_OF_R1, *apart) == [("standing", ""), ("idle", ""), ("frozen", "")]
    beside = truth_of("r2", 13.0, 13.0), truth_of("r3", 22.0, 13.0, stepping=False, powered=False)
    assert states(5, TRUTH_OF_R1, *beside) == [("blocked", "r2"), ("driving", ""), ("off", "")]
    assert states(6, truth_of("r1", 12.2, 13.0), *beside)[0] == ("driving", "")


def test_orders_in_a_row_are_one_line_and_old_lines_are_forgotten() -> None:
    lines = OrderLines()
    for series, order, refusal in (
        (7, "move r1 1 1 0", ""), (7, "move r1 1 2 0", "no room"), (7, "move r1 1 3 0", ""),
        (8, "move r1 1 4 0", ""), (0, "thaw r1", "no"), (0, "thaw r1", "no"),
    ):  # fmt: skip
        lines.end(lines.begin(Ask(series, order)), refusal)
    assert lines.fresh() == lines.kept() == (
        OrderLine(1, "move r1 1 3 0", times=3, refused=1, refusal="no room"),
        OrderLine(2, "move r1 1 4 0"),
        OrderLine(3, "thaw r1", times=2, refused=2, refusal="no"),
    )  # fmt: skip
    assert lines.fresh() == ()
    numbers = [lines.begin(Ask(0, f"step {number}")) for number in range(KEPT + 1)]
    for number in numbers:
        lines.end(number, "")
    assert [line.number for line in lines.kept()] == numbers[1:]
    assert all(line.waiting == 0 for line in lines.kept())


def test_a_line_says_when_the_run_says_nothing() -> None:
    now, stage, mesh, lines = [0.0], scene(), Mesh(), OrderLines()
    link = RunLink(stage, lines, mesh, mesh, lambda: now[0])
    link.give(Ask(0, "pause"))
    assert lines.kept() == (OrderLine(1, "pause", waiting=1),)
    now[0] = PATIENCE_S + 1
    link.look()
    silent = "the run has not said yet; it heeds the order at its next step"
    assert lines.kept() == (OrderLine(1, "pause", refused=1, refusal=silent),)


def test_the_word_of_every_state_can_be_read() -> None:
    told = page_floor.state_colours()
    assert tuple(told) == page_floor.STATES
    for ground, letters in told.values():
        assert contrast(rgb(ground), rgb(letters)) >= 4.5


def rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


Trial = Callable[[Any, Mesh, Any], Awaitable[None]]


def served(trial: Trial) -> Callable[[], None]:
    """Make a test of a trial that talks to the server of a scene whose run is a Mesh."""

    def test() -> None:
        async def play() -> None:
            mesh, stage, lines = Mesh(), scene(), OrderLines()
            link = RunLink(stage, lines, mesh, mesh)
            pages = server.ControlServer(stage, lines, link.give)
            async with await pages.start():
                await trial(pages, mesh, link)

        asyncio.run(play())

    return test


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


@served
async def test_only_the_page_with_the_token_gets_in(pages: Any, mesh: Mesh, link: Any) -> None:
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


async def _status(pages: Any, path: str, host: str | None) -> int:
    port = int(pages.url.split(":")[2].split("/")[0])
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: {host or f'127.0.0.1:{port}'}\r\n\r\n".encode())
    line = await reader.readline()
    writer.close()
    return int(line.split()[1])


@served
async def test_an_order_of_a_page_is_given_to_the_run_and_answered(pages: Any, mesh: Mesh, link: Any) -> None:
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


@served
async def test_junk_is_counted_and_ends_the_page_that_sends_it(pages: Any, mesh: Mesh, link: Any) -> None:
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


@served
async def test_a_page_that_reads_nothing_delays_no_other(pages: Any, mesh: Mesh, link: Any) -> None:
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


@pytest.mark.parametrize(
    "data",
    ["", "[]", "{}", "x" * 2000, '{"series": -1, "order": "pause"}', '{"series": 1, "order": ""}', "[" * 900,
     '{"series": 1, "order": "pause", "more": 1}', '{"series": "1", "order": "pause"}', b"\xff\xfe"],
)  # fmt: skip
def test_what_is_no_order(data: str | bytes) -> None:
    with pytest.raises(JunkError):
        ask(data)


@served
async def test_the_ninth_page_is_told_why_it_is_closed(pages: Any, mesh: Mesh, link: Any) -> None:
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
