"""Server and scene of the map page, without a browser."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from itertools import cycle
from typing import Any

import msgspec
import pytest

from actors.installation.repository import REPOSITORY
from actors.items import ItemKey
from actors.messages import (
    ANSWERED,
    CONTROL,
    Control,
    Drive,
    FloorChanged,
    FrameReceived,
    ItemMark,
    Jam,
    OrderOutcomes,
    Progress,
    RadioEvents,
    RobotTruth,
    TaskChanged,
    Truth,
    UnmappedObstacle,
)
from actors.observer.glyphs import contrast
from actors.orders import Freeze, ItemAssignment, Move, Speed
from actors.radio.radio_model import RadioSetup
from actors.runtime.codec import decode, encode
from actors.runtime.core import Delivery, at
from actors.task.loading import task_setup
from actors.task.task import MarkStyle
from actors.topic import Message, Topic
from actors.world.world_setup import BodySetup, TimedOrder, WorldSetup
from deploy.control.scene import STATES, Scene, state_colours

server = pytest.importorskip("deploy.control.server", reason="websockets comes with `./acrc run --control`")
client = pytest.importorskip("websockets.asyncio.client")
exceptions = pytest.importorskip("websockets.exceptions")


def truth_of(robot: str, x: float, y: float, *, stepping: bool = True, powered: bool = True) -> RobotTruth:
    return RobotTruth(robot, x, y, 0.5, 0, 0, 0, stepping=stepping, powered=powered, transmits=0)


TRUTH_OF_R1 = truth_of("r1", 12.0, 13.0)
TASK = task_setup("cleaning", {})
MAP = REPOSITORY / "maps" / "corridor.yaml"


class Mesh:
    """Bus between server and test, which plays the run."""

    def __init__(self) -> None:
        self.given: list[Control] = []
        self.says: dict[str, list[bytes]] = {}

    def publish(self, key: str, payload: bytes) -> None:
        told = decode(at(CONTROL).topic, key, payload)
        assert isinstance(told, Control)
        self.given.append(told)

    def answer(self, link: Any, refusal: str) -> None:
        """Answer the last order on behalf of the run."""
        told = OrderOutcomes(0, self.given[-1].ticket, (refusal,) if refusal else ())
        self.says[ANSWERED.pattern] = [encode(told, ANSWERED.key())]
        link.poll()

    def receive(self, topic: Topic[Message]) -> Delivery:
        raise NotImplementedError

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        waiting = self.says.get(topic.pattern)
        return Delivery(topic, topic.key("r2"), waiting.pop(0)) if waiting else None


def world(*events: TimedOrder) -> WorldSetup:
    items = {"r1": ((13.0, 13.0), (14.0, 13.0)), "r2": (), "r3": ()}
    start = (12.0, 13.0, 0.0)
    robots = [
        BodySetup(id=robot, model="turtlebot2", sensor=None, odometry="exact", start=start, items=own)
        for robot, own in items.items()
    ]
    return WorldSetup(str(MAP), 1, 100_000, 1_000_000, tuple(robots), TASK, events)


def scene(*events: TimedOrder) -> Scene:
    robots = (("r1", 1), ("r2", 2), ("r3", 3))
    return Scene(world(*events), RadioSetup(seed=1, step_us=100_000, robots=robots), 2.0)


def said(stage: Scene, message: Message, robot: str = "r1") -> None:
    topic = next(one for one in server.TOPICS if one.kind is type(message))
    stage.take(topic.key(robot), message)


def truth(step: int, *robots: RobotTruth, jams: tuple[Jam, ...] = ()) -> Truth:
    mine = {
        one.id: one for one in (truth_of("r2", 20.0, 13.0), truth_of("r3", 22.0, 13.0), TRUTH_OF_R1, *robots)
    }
    return Truth(step, step * 100_000, tuple(mine[robot] for robot in ("r1", "r2", "r3")), jams)


def test_the_scene_follows_messages_and_orders_that_were_carried_out() -> None:
    stage = scene()
    assert len(stage.floor()["doors"]) == 5
    said(
        stage, TaskChanged(0, (ItemMark("r1", 0, 13.0, 13.0, "open"), ItemMark("r1", 1, 14.0, 13.0, "open")))
    )
    said(stage, TaskChanged(0, (ItemMark("r1", 1, 14.0, 13.0, "done", "r2"),)))
    said(stage, Progress(0, 0, 1, 1, finished=False))
    said(stage, RadioEvents(0, (FrameReceived(0, 2, -70.0, 255, b""),)))
    said(stage, truth(0, jams=(Jam(1.0, 1.0, 3.0, 250_000),)))
    said(stage, Control(0, (Move("r1", 3.0, 4.0, 0.0), Speed(0.5)), "a"))
    said(stage, Control(0, (Freeze("r1"), Speed(7.0)), "b"))
    assert stage.state()["speed"] == 2.0
    said(stage, OrderOutcomes(1, "a", ()))
    said(stage, OrderOutcomes(1, "b", ("no",)))
    said(stage, Progress(1, 100_000, 1, 1, finished=False, paused=True))
    wall, door = (
        UnmappedObstacle(0, "wall", ((1.0, 1.0), (2.0, 1.0)), 0.05),
        UnmappedObstacle(1, "closed door", ((5.0, 2.0), (5.0, 3.0)), 0.05),
    )
    said(stage, FloorChanged(1, (wall, door)))
    state = stage.state()
    assert state["robots"][0] == ("r1", 3.0, 4.0, 0.0, "driving", (13.0, 13.0), "")
    assert state["things"] == [
        ("wall", [*wall.points], 0.05, 0.0), ("closed door", [*door.points], 0.05, 0.0),
        ("jammer", [(1.0, 1.0)], 3.0, 0.25),
    ]  # fmt: skip
    assert (state["paused"], state["speed"], state["links"]) == (True, 0.5, [(0, 1)])
    assert state["items"] == [("r1", 13.0, 13.0, "open", ""), ("r1", 14.0, 13.0, "done", "r2")]
    assert (state["left"], state["done"]) == (1, 1)
    said(stage, truth(3))
    said(stage, FloorChanged(3, (), (1, 77)))
    state = stage.state()
    assert [one[0] for one in state["things"]] == ["wall"] and state["missed"] == 2
    assert (state["paused"], state["t"], state["over"]) == (False, 0.3, False)
    said(stage, TaskChanged(3, (ItemMark("r1", 2, 7.0, 7.0, "given"), ItemMark("r1", 1, 14.0, 13.0, ""))))
    said(stage, Drive(4, 0.0, 0.0, 0.0, 0, (), (), (ItemKey("r1", 2),)))
    said(stage, truth(4))
    state = stage.state()
    assert [one[3] for one in state["items"]] == ["open", "given"] and state["robots"][0][5] == (7.0, 7.0)
    said(stage, Truth(5, 500_000, (), halt=True))
    assert stage.state()["over"]


def test_items_of_another_task_are_drawn_by_its_symbols_and_given_as_text() -> None:
    declaration = msgspec.structs.replace(
        TASK.declaration,
        item="order",
        items="orders",
        done="delivered",
        marks={"waiting": MarkStyle("square", "order", True), "odd": MarkStyle("heart", "<b>")},
        schemas={"item": {"type": "object"}},
        lists_items=False,
    )
    setup = msgspec.structs.replace(world(), task=msgspec.structs.replace(TASK, declaration=declaration))
    robots = (("r1", 1), ("r2", 2), ("r3", 3))
    stage = Scene(setup, RadioSetup(seed=1, step_us=100_000, robots=robots), 2.0)
    floor = stage.floor()
    assert (floor["item"], floor["items"], floor["done"], floor["is_point"]) == (
        "order", "orders", "delivered", False,
    )  # fmt: skip
    assert scene().floor()["is_point"]
    assert floor["marks"] == {"waiting": ("square", "", "order"), "odd": ("ring", "", "<b>")}
    for second in range(4):
        said(stage, truth(second * 10))
    assert [one[4] for one in stage.state()["robots"]] == ["standing"] * 3, "they may have orders"

    mesh = Mesh()
    link = server.RunLink(stage, mesh, mesh)
    link.send_order('give r1 {"from": [1, 2], "by": 30}')
    assert mesh.given[0].orders == (ItemAssignment("r1", ({"from": [1, 2], "by": 30},)),)
    link.send_order('give r1 {"from": [1')
    assert link.lines[-1].refused == 1 and "give ROBOT X Y|JSON" in link.lines[-1].refusal


def test_standing_and_blocked_robots() -> None:
    stage = scene()

    def states(second: int, *robots: RobotTruth) -> list[tuple[str, str]]:
        said(stage, truth(second * 10, *robots))
        return [(one[4], one[6]) for one in stage.state()["robots"]]

    apart = truth_of("r2", 20.0, 13.0), truth_of("r3", 22.0, 13.0, stepping=False)
    for second in range(3):
        assert states(second, TRUTH_OF_R1, *apart) == [("driving", ""), ("driving", ""), ("frozen", "")]
    assert states(3, TRUTH_OF_R1, *apart) == [("standing", ""), ("idle", ""), ("frozen", "")]
    beside = truth_of("r2", 13.0, 13.0), truth_of("r3", 22.0, 13.0, stepping=False, powered=False)
    assert states(5, TRUTH_OF_R1, *beside) == [("blocked", "r2"), ("driving", ""), ("off", "")]
    assert states(6, truth_of("r1", 12.2, 13.0), *beside)[0] == ("driving", "")


def test_repeated_orders_share_a_line_and_old_lines_are_dropped() -> None:
    mesh = Mesh()
    link = server.RunLink(scene(), mesh, mesh)
    for order, refusal in (
        ("move r1 1 1 0", ""), ("move r1 1 2 0", "no room"), ("move r1 1 3 0", ""),
        ("move r2 1 4 0", ""), ("thaw r1", "no"), ("thaw r1", "no"),
    ):  # fmt: skip
        link.send_order(order)
        mesh.answer(link, refusal)
    assert [(one.order, one.times, one.waiting, one.refused, one.refusal) for one in link.lines] == [
        ("move r1 1 3 0", 3, 0, 1, "no room"), ("move r2 1 4 0", 1, 0, 0, ""), ("thaw r1", 2, 0, 2, "no"),
    ]  # fmt: skip
    for number in range(server.MAX_LINES + 1):
        link.send_order(f"step {number + 1}")
        mesh.answer(link, "")
    assert [line.number for line in link.lines] == list(range(5, server.MAX_LINES + 5))


def test_a_line_shows_a_missing_answer() -> None:
    now, mesh = [0.0], Mesh()
    link = server.RunLink(scene(), mesh, mesh, lambda: now[0])
    link.send_order("pause")
    assert link.lines[0].waiting == 1
    now[0] = server.ANSWER_TIMEOUT_S + 1
    link.poll()
    assert (link.lines[0].waiting, link.lines[0].refusal) == (0, server.UNANSWERED)


def test_state_labels_have_sufficient_contrast() -> None:
    for state in STATES:
        (red, green, blue), (ink, *_) = (bytes.fromhex(colour[1:]) for colour in state_colours(state))
        assert contrast((red, green, blue), (ink, ink, ink)) >= 4.5


Trial = Callable[[Any, Mesh, Any], Awaitable[None]]


def served(trial: Trial) -> Callable[[], None]:
    """Turn a coroutine with a server, its bus and link into a test."""

    def test() -> None:
        async def play() -> None:
            mesh, stage = Mesh(), scene()
            link = server.RunLink(stage, mesh, mesh)
            pages = server.ControlServer(stage, link)
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
    """Return a line of the list of orders after its answer."""
    while True:
        await asyncio.sleep(0.01)
        pages.send_changes()
        told = await heard(connection, "order")
        if told["number"] == number and not told["waiting"]:
            return told


@served
async def test_the_page_requires_its_token(pages: Any, mesh: Mesh, link: Any) -> None:
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
async def test_an_order_of_a_page_is_sent_to_the_run_and_answered(pages: Any, mesh: Mesh, link: Any) -> None:
    async with socket(pages) as page:
        assert list((await heard(page, "floor"))["robots"]) == ["r1", "r2", "r3"]
        await page.send("move r1 1 2 0")
        await page.send("dance")
        told = await told_line(pages, page, 2)
        assert told["refused"] == 1 and told["refusal"].startswith("VERB: dance; must be one of")
        (given,) = mesh.given
        assert given.orders == (Move("r1", 1.0, 2.0, 0.0),)
        answer = encode(OrderOutcomes(0, given.ticket, ("at 3 s: no",)), ANSWERED.key())
        mesh.says[ANSWERED.pattern] = [answer]
        link.poll()
        refused = {
            "kind": "order", "number": 1, "order": "move r1 1 2 0", "times": 1, "waiting": 0, "refused": 1,
            "refusal": "at 3 s: no", "version": 4,
        }  # fmt: skip
        assert await told_line(pages, page, 1) == refused
        async with socket(pages) as later:
            assert await heard(later, "order") == refused
            assert (await heard(later, "order"))["order"] == "dance"


@served
async def test_invalid_messages_are_counted_and_close_their_page(pages: Any, mesh: Mesh, link: Any) -> None:
    async with socket(pages) as other, socket(pages) as page:
        for _, junk in zip(
            range(server.MAX_INVALID_MESSAGES), cycle((b"\xff\x00[[[", b"pause", "")), strict=False
        ):
            await page.send(junk)
        with pytest.raises(exceptions.ConnectionClosed):
            while True:
                await asyncio.wait_for(page.recv(), 5)
        assert (pages.invalid, mesh.given) == (server.MAX_INVALID_MESSAGES, [])
        async with socket(pages) as large:
            await large.send("x" * (server.MAX_ORDER_LENGTH + 1))
            with pytest.raises(exceptions.ConnectionClosed) as closed:
                while True:
                    await asyncio.wait_for(large.recv(), 5)
            assert closed.value.rcvd.code == 1009
        await heard(other, "floor")
        while (await heard(other, "state"))["junk"] != server.MAX_INVALID_MESSAGES:
            link._scene.changed = True
            pages.send_changes()


@served
async def test_a_page_that_reads_nothing_delays_no_other(pages: Any, mesh: Mesh, link: Any) -> None:
    async with socket(pages) as slow, socket(pages) as quick:
        slow.transport.pause_reading()
        await heard(quick, "floor")
        for number in range(200):
            await asyncio.sleep(0)
            said(link._scene, truth(number))
            pages.send_changes()
            while (await heard(quick, "state"))["step"] != number:
                pass
        slow.transport.abort()


@served
async def test_the_ninth_page_is_closed_with_a_reason(pages: Any, mesh: Mesh, link: Any) -> None:
    opened = [await socket(pages) for _ in range(server.MAX_PAGES)]
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
