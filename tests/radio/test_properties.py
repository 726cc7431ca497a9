"""Properties of any pattern of frames of robots."""

from hypothesis import given, settings
from hypothesis import strategies as st

from actors.messages import AccessFailure, FrameOverflow, FrameReceived, FrameSent, RadioEvent
from actors.radio.radio_model import preset
from tests.radio.swarm import Frame, Robot, Swarm, around

HORIZON = 60_000
NAMES = ("a", "b", "c", "d", "e")

places = st.lists(
    st.tuples(st.floats(0.0, 25.0), st.floats(0.0, 3.0)), min_size=len(NAMES), max_size=len(NAMES)
).map(lambda spots: {name: Robot(*spot) for name, spot in zip(NAMES, spots, strict=True)})
traffic = st.lists(
    st.tuples(st.integers(0, HORIZON - 1), st.sampled_from(NAMES), st.integers(1, 118)), max_size=40
).map(lambda rows: [Frame(t, name, tag, bytes(size)) for tag, (t, name, size) in enumerate(rows)])
quick = settings(max_examples=40, deadline=None, derandomize=True)
CHAPTER = preset("chapter")


def played(robots: dict[str, Robot], frames: list[Frame], step_us: int = 20_000, plain: bool = True) -> Swarm:
    swarm = Swarm(dict(robots), step_us) if plain else Swarm(dict(robots), step_us, around(CHAPTER))
    # Eight frames may wait for 43 ms each when the last is asked for.
    swarm.run_all(frames, (HORIZON + 360_000) // step_us + 1)
    assert swarm.core.counters()["frames_pending"] == 0
    return swarm


@quick
@given(robots=places, frames=traffic, plain=st.booleans())
def test_every_frame_and_every_copy_has_one_outcome(
    robots: dict[str, Robot], frames: list[Frame], plain: bool
) -> None:
    swarm = played(robots, frames, plain=plain)
    counters = swarm.core.counters()
    ends = [counters[f"frames_{end}"] for end in ("sent", "overflowed", "access_failure")]
    assert sum(ends) == len(frames)
    sent = {(robot, e.tag) for robot, some in swarm.given.items() for e in some if isinstance(e, FrameSent)}
    wire = sum(len(frame.data) + 9 for frame in frames if (frame.robot, frame.tag) in sent)
    assert counters["bytes_sent"] == wire
    events: list[RadioEvent] = [event for some in swarm.given.values() for event in some]
    assert sum(isinstance(e, FrameReceived) for e in events) == counters["copies_heard"]
    for kind, count in zip((FrameSent, FrameOverflow, AccessFailure), ends, strict=True):
        assert sum(isinstance(e, kind) for e in events) == count
    by_robot = swarm.core.counters_by_robot()
    for name, mine in by_robot.items():  # every frame of the others ended in one way for this robot
        copies = sum(count for cause, count in mine.items() if cause.startswith("copies_"))
        others = [theirs for other, theirs in by_robot.items() if other != name]
        never = sum(t["frames_overflowed"] + t["frames_access_failure"] for t in others)
        assert copies == sum(theirs["frames_sent"] for theirs in others)
        assert copies + never == sum(frame.robot != name for frame in frames)
    for cause in by_robot["a"]:
        assert sum(mine[cause] for mine in by_robot.values()) == counters[cause]


@quick
@given(robots=places, frames=traffic, step_us=st.sampled_from([4_160, 10_000, 50_000, 100_000]))
def test_the_step_size_does_not_matter(robots: dict[str, Robot], frames: list[Frame], step_us: int) -> None:
    coarse, fine = played(robots, frames, plain=False), played(robots, frames, step_us, plain=False)
    assert fine.given == coarse.given
    assert fine.core.counters() == coarse.core.counters()


switches = st.lists(
    st.tuples(st.integers(0, 90), st.sampled_from(NAMES), st.booleans(), st.booleans()), max_size=20
)


@quick
@given(robots=places, frames=traffic, changes=switches)
def test_all_frames_are_counted_with_restarts(
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
