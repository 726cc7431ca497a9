"""What holds for every pattern of frames; an independent plain model is the oracle."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from actors.messages import Heard, Overflow, RadioEvent, Sent
from actors.radio.parameters import preset
from actors.radio.path_loss import reach
from tests.radio.swarm import Frame, Robot, Swarm

HORIZON = 60_000
NAMES = ("a", "b", "c", "d", "e")
REACH = reach(preset("chapter"))

places = st.lists(
    st.tuples(st.floats(0.0, 25.0), st.floats(0.0, 3.0)), min_size=len(NAMES), max_size=len(NAMES)
).map(lambda spots: {name: Robot(*spot) for name, spot in zip(NAMES, spots, strict=True)})
traffic = st.lists(
    st.tuples(st.integers(0, HORIZON - 1), st.sampled_from(NAMES), st.integers(1, 118)), max_size=40
).map(lambda rows: [Frame(t, name, tag, bytes(size)) for tag, (t, name, size) in enumerate(rows)])
quick = settings(max_examples=150, deadline=None, derandomize=True)


def played(robots: dict[str, Robot], frames: list[Frame], step_us: int = 20_000) -> Swarm:
    """The swarm after all frames have been sent."""
    swarm = Swarm(dict(robots), step_us)
    # Eight frames may wait for 4.3 ms each when the last is asked for.
    swarm.run_all(frames, (HORIZON + 40_000) // step_us + 1)
    assert swarm.core.counters()["frames_pending"] == 0
    return swarm


def in_range(one: Robot, other: Robot) -> bool:
    return math.hypot(one.x - other.x, one.y - other.y) <= REACH


def sendings(swarm: Swarm, frames: list[Frame]) -> list[tuple[int, int, Frame]]:
    """Begin, end and frame of everything that was in the air, from the Sent events."""
    ends = {
        (robot, event.tag): event.instant
        for robot, events in swarm.given.items()
        for event in events
        if isinstance(event, Sent)
    }
    sent = [frame for frame in frames if (frame.robot, frame.tag) in ends]
    return [(ends[f.robot, f.tag] - (f.end - f.instant), ends[f.robot, f.tag], f) for f in sent]


@quick
@given(robots=places, frames=traffic)
def test_each_robot_hears_exactly_what_a_plain_model_lets_it_hear(
    robots: dict[str, Robot], frames: list[Frame]
) -> None:
    swarm = played(robots, frames)
    air = sendings(swarm, frames)
    for name, robot in robots.items():
        expected = []
        for begin, end, frame in air:
            if frame.robot == name or not in_range(robot, robots[frame.robot]):
                continue
            overlapping = [other for b, e, other in air if b < end and begin < e and other is not frame]
            disturbed = any(in_range(robot, robots[other.robot]) for other in overlapping)
            if not disturbed:
                expected.append((end, 100 + NAMES.index(frame.robot), frame.data))
        heard = [(e.instant, e.sender, e.data) for e in swarm.given.get(name, []) if isinstance(e, Heard)]
        assert sorted(heard) == sorted(expected)


@quick
@given(robots=places, frames=traffic)
def test_nobody_hears_beyond_range(robots: dict[str, Robot], frames: list[Frame]) -> None:
    swarm = played(robots, frames)
    for name, events in swarm.given.items():
        for event in events:
            if isinstance(event, Heard):
                assert in_range(robots[name], robots[NAMES[event.sender - 100]])
                assert event.rssi_dbm >= -95.0
                assert 0 <= event.lqi <= 255


@quick
@given(robots=places, frames=traffic)
def test_air_time_adds_up(robots: dict[str, Robot], frames: list[Frame]) -> None:
    """A transceiver sends at once or right after its last frame, one frame at a time, in order."""
    swarm = played(robots, frames)
    air = sendings(swarm, frames)
    for name in NAMES:
        free = 0
        for begin, end, frame in sorted(
            (entry for entry in air if entry[2].robot == name), key=lambda e: e[:2]
        ):
            assert begin == max(frame.instant, free)
            free = end


@quick
@given(robots=places, frames=traffic)
def test_every_frame_and_every_copy_has_one_outcome(robots: dict[str, Robot], frames: list[Frame]) -> None:
    swarm = played(robots, frames)
    counters = swarm.core.counters()
    assert counters["frames_sent"] + counters["frames_overflowed"] == len(frames)
    wire = sum(len(frame.data) + 9 for _, _, frame in sendings(swarm, frames))
    assert counters["bytes_sent"] == wire
    copies = sum(count for name, count in counters.items() if name.startswith("copies_"))
    assert copies == counters["frames_sent"] * (len(NAMES) - 1)
    events: list[RadioEvent] = [event for some in swarm.given.values() for event in some]
    assert sum(isinstance(e, Heard) for e in events) == counters["copies_heard"]
    assert sum(isinstance(e, Sent) for e in events) == counters["frames_sent"]
    assert sum(isinstance(e, Overflow) for e in events) == counters["frames_overflowed"]


@quick
@given(robots=places, frames=traffic, step_us=st.sampled_from([1_000, 4_160, 10_000, 50_000, 100_000]))
def test_the_step_size_changes_nothing(robots: dict[str, Robot], frames: list[Frame], step_us: int) -> None:
    coarse, fine = played(robots, frames), played(robots, frames, step_us)
    assert fine.given == coarse.given
    assert fine.core.counters() == coarse.core.counters()


switches = st.lists(
    st.tuples(st.integers(0, 90), st.sampled_from(NAMES), st.booleans(), st.booleans()), max_size=20
)


@quick
@given(robots=places, frames=traffic, changes=switches)
def test_nothing_is_lost_uncounted_when_robots_come_and_go(
    robots: dict[str, Robot], frames: list[Frame], changes: list[tuple[int, str, bool, bool]]
) -> None:
    swarm = Swarm(dict(robots), 1_000)
    asked = 0
    for step in range(110):
        for at_step, name, powered, stepping in changes:
            if at_step == step:
                swarm.change(name, powered=powered, stepping=stepping and powered)
        now = [f for f in frames if f.instant // 1_000 == step]
        asked += sum(swarm.robots[f.robot].stepping for f in now)
        swarm.run(now)
    c = swarm.core.counters()
    ends = ("sent", "cut_off", "overflowed", "refused", "discarded", "pending")
    assert sum(c[f"frames_{end}"] for end in ends) == asked
    events = sum(len(some) for some in swarm.given.values())
    for robot in NAMES:  # thaw them all to see what was held
        swarm.change(robot, powered=True, stepping=True)
    swarm.run()
    held = sum(len(some) for some in swarm.given.values()) - events
    said = c["copies_heard"] + c["frames_sent"] + c["frames_overflowed"]
    lost = c["events_dropped"] + swarm.core.counters()["events_discarded"]
    assert events + held + lost == said
