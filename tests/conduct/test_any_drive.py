"""Properties of the world for whatever a robot can put on the wire as a Drive."""

import math
from typing import Any

import msgspec
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from actors.messages import DRIVE, Drive
from actors.runtime.codec import decode, encode
from actors.runtime.errors import AcrcError
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from actors.world.whereabouts import PoseError
from tests.conduct.theatre import Theatre

LIAR, STEP = "r1", 1

any_float = st.floats(width=64)
any_whole = st.integers(-(2**63), 2**64 - 1)
owners = st.sampled_from(["r1", "r2"]) | st.text(max_size=40)
numbers = st.just(0) | any_whole
instants = st.integers(100_000, 199_999) | any_whole
velocities = st.floats(-1.0, 1.0) | any_float
poses = st.tuples(velocities, velocities, velocities)
reports = st.builds(PlaceReport, owners, numbers, instants)
given_up = st.builds(PlaceGivenUp, owners, numbers, instants, st.text(max_size=120))
routes = st.lists(st.builds(PlaceKey, owners, numbers), max_size=4).map(tuple)
drives = st.builds(
    Drive,
    step=st.just(STEP) | any_whole,
    vx=velocities,
    vy=velocities,
    omega=velocities,
    transmits=st.just(0) | any_whole,
    reports=st.lists(reports, max_size=3).map(tuple),
    given_up=st.lists(given_up, max_size=3).map(tuple),
    route=st.none() | routes,
    pose=st.none() | poses,
)


def finite(value: Any) -> bool:
    """True if no number in a value of plain structures is NaN or infinite."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, list):
        return all(map(finite, value))
    return finite(list(value.values())) if isinstance(value, dict) else True


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@example(Drive(STEP, 1e5, -1e5, 1e5, 0, pose=(1e5, -1e5, 1e5)))
@example(Drive(STEP, 5e-324, -0.0, math.inf, 0))
@given(drives)
def test_whatever_a_robot_says_the_world_goes_on_with_finite_numbers_or_names_it(drive: Drive) -> None:
    wire = encode(drive)
    assert encode(decode(DRIVE, DRIVE.key(LIAR), wire)) == wire  # type: ignore[arg-type]
    play = Theatre(0.5)
    play.acts[LIAR].lies = {STEP: drive}
    try:
        play.run()
    except AcrcError as error:
        assert str(error).startswith((f"step {STEP} (0.1 s): {LIAR} ", "nobody can go on: "))
        # a frame that was announced and never comes is waited for
        assert not str(error).startswith("nobody") or 0 < drive.transmits <= 32
    else:
        assert play.core.step == 5 or all(place.settled_at is not None for place in play.places)
    assert all(finite(msgspec.to_builtins(truth)) for truth in play.truths)
    for judged in (*play.places, *play.core.pose_errors.values()):
        assert finite(msgspec.to_builtins(judged))
        assert not isinstance(judged, PoseError) or 0 <= judged.greatest <= 2e5
    assert len(msgspec.json.encode(play.places)) < 2000
