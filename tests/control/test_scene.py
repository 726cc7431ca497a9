"""What the page is told of a run: states, links, orders, without a server."""

import msgspec

from actors.messages import (
    RECEIVED,
    Answered,
    Control,
    Drive,
    Heard,
    Jam,
    Progress,
    Received,
    RobotTruth,
    Truth,
)
from actors.observer.glyphs import Colour, contrast
from actors.orders import (
    CloseDoor,
    Freeze,
    Give,
    Kill,
    Move,
    Obstacle,
    OpenDoor,
    Order,
    Restart,
    Speed,
    Thaw,
    Wall,
)
from actors.runtime.codec import encode
from actors.task.words import PlaceKey, PlaceReport
from actors.world.world_setup import TimedOrder
from deploy.control import onlooking, page_floor
from deploy.control.run_link import KEPT, PATIENCE_S, OrderLines, RunLink
from deploy.control.wire import Ask, MapRobot, OrderLine, Place
from tests.control.stage import TRUTH_OF_R1, Mesh, scene, truth_of


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
    assert state.robots == (MapRobot("r1", 3.0, 4.0, 0.0, "driving", (13.0, 13.0)),)
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


def test_what_is_ordered_of_a_robot_shows_while_the_run_is_paused() -> None:
    stage = scene()
    stage.take(Truth(0, 0, (TRUTH_OF_R1,)))
    ordered: list[tuple[Order, str]] = [
        (Freeze("r1"), "frozen"), (Thaw("r1"), "driving"), (Kill("r1"), "off"), (Restart("r1"), "driving"),
    ]  # fmt: skip
    for number, (order, state) in enumerate(ordered):
        stage.take(Control(0, (order,), str(number)))
        stage.take(Answered(1, str(number), ()))
        assert stage.state(junk=0).robots[0].state == state


def test_who_stands_and_who_is_blocked() -> None:
    stage = scene(others=2)

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


def test_who_heard_whom_lately_is_linked_and_no_more_than_can_be_drawn() -> None:
    stage, mesh = scene(others=99), Mesh()
    link = RunLink(stage, OrderLines(), mesh, mesh)
    mesh.says[RECEIVED.pattern] = [
        encode(Received(1, (Heard(90_000, sender, -60.0, 255, b""),)), RECEIVED.key("r2"))
        for sender in (3, 1, 999)
    ]
    link.look()
    assert stage.state(junk=0).links == (), "the newest is taken, and who it names is nobody's"
    for sender in (3, 1):
        stage.take(Received(1, (Heard(90_000, sender, -60.0, 255, b""),)), "r2")
    assert stage.state(junk=0).links == ((0, 1), (1, 2))
    stage.take(Truth(31, 3_100_000, (TRUTH_OF_R1,)))
    assert stage.state(junk=0).links == ()
    everybody = tuple(Heard(3_100_000, sender, -60.0, 255, b"") for sender in range(1, 101))
    for number in range(1, 101):
        stage.take(Received(31, everybody), f"r{number}")
    state = stage.state(junk=0)
    assert len(state.links) == onlooking.LINKS
    assert len(msgspec.json.encode(state)) < 16_000, "a hundred robots: 20 such messages a second"


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
        assert contrast(colour_of(ground), colour_of(letters)) >= 4.5


def colour_of(text: str) -> Colour:
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue
