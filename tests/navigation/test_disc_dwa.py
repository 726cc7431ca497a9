"""The kernel compared with a reference, and properties of its choices."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from actors.array_types import Flags, Floats, Int32s
from actors.robot.navigation.disc_dwa import INVALID, WEIGHTS, CriticFields, best_velocity
from actors.robot.navigation.map_grid import Waves, wavefront
from actors.robot.navigation.ray_tracing import squared_within

Numbers = dict[str, float]


@dataclass(frozen=True)
class Trajectory:
    speed: float
    turn: float
    points: list[tuple[float, float]]
    """Distance until it became invalid, cells."""
    score: float
    room: float = 0.0
    """Smallest excess over the required distance, cells."""


def squared_at(marks: Flags, x: float, y: float, most: float) -> float:
    """Return the squared distance from a point to the nearest mark's centre, at most `most`."""
    rows, columns = np.nonzero(marks)
    if not rows.size:
        return most
    return min(most, float(np.min((columns + 0.5 - x) ** 2 + (rows + 0.5 - y) ** 2)))


def samples(low: float, high: float, count: int) -> list[float]:
    if low == high:
        return [low]
    values = [low + (high - low) * k / (count - 1) for k in range(count)]
    if low < 0 < high and 0.0 not in values:
        values.append(0.0)
    return sorted(values)


def nearest_steps(steps: Int32s, x: float, y: float) -> int:
    if steps[int(y), int(x)] < steps.size:
        return int(steps[int(y), int(x)])
    row, column = int(y - 0.5), int(x - 0.5)
    return int(steps[row : row + 2, column : column + 2].min())


class ReferenceDwa:
    def __init__(self, fields: CriticFields, marks: Flags, table: Floats, w: Numbers) -> None:
        self.fields, self.marks, self.table, self.w = fields, marks, table, w

    def limit(self, speed: float) -> float:
        w = self.w
        share = max(0.0, abs(speed) - w["scaling_speed"]) / w["scaling_range"]
        return w["radius"] * (1 + w["scaling_factor"] * share) + w["padding"]

    def trajectories(
        self, pose: tuple[float, float, float], window: Floats, counts: tuple[int, int]
    ) -> list[Trajectory]:
        found = []
        for speed in samples(window[0], window[1], counts[0]):
            for turn in samples(window[2], window[3], counts[1]):
                if abs(speed) < self.w["least_speed"] - 1e-4 and abs(turn) < self.w["least_turn"] - 1e-4:
                    continue
                found.append(self._drive(pose, speed, turn))
        return found

    def _drive(self, pose: tuple[float, float, float], speed: float, turn: float) -> Trajectory:
        w, side = self.w, self.marks.shape[0]
        stopping = abs(speed) / w["deceleration"] + w["stop_buffer"]
        time = max(w["horizon"], stopping)
        count = max(1, math.ceil(max(abs(speed) * time / w["stride"], abs(turn) * time / w["turn_stride"])))
        count = count if speed else 1
        chord = abs(speed) * time / count * (np.sinc(turn * time / count / math.tau) if turn else 1.0)
        last = count
        if count * chord > w["goal_distance"]:
            braking = abs(speed) * w["stop_buffer"] + speed**2 / (2 * w["deceleration"])
            last = min(count, math.ceil(max(w["goal_distance"], braking) / chord))
        x, y, heading = pose
        points = [(x, y)]
        least = squared_at(self.marks, x, y, self.fields.squared.max())
        if least <= self.limit(speed) ** 2:
            return Trajectory(speed, turn, points, INVALID)
        for k in range(1, last + 1):
            t = k * time / count
            if turn:
                x = pose[0] + speed / turn * (math.sin(pose[2] + turn * t) - math.sin(pose[2]))
                y = pose[1] - speed / turn * (math.cos(pose[2] + turn * t) - math.cos(pose[2]))
            else:
                x, y = pose[0] + speed * t * math.cos(pose[2]), pose[1] + speed * t * math.sin(pose[2])
            points.append((x, y))
            if not (0.5 <= x < side - 0.5 and 0.5 <= y < side - 0.5):
                return Trajectory(speed, turn, points, INVALID)
            here = squared_at(self.marks, x, y, self.fields.squared.max())
            if here <= self.limit(speed) ** 2:
                return Trajectory(speed, turn, points, INVALID)
            least = min(least, here)
            heading = pose[2] + turn * t
        room = math.sqrt(least) - self.limit(speed)
        return Trajectory(speed, turn, points, self._score(least, x, y, heading), room)

    def _score(self, least: float, x: float, y: float, heading: float) -> float:
        w, side = self.w, self.marks.shape[0]
        path, goal = nearest_steps(self.fields.waves.path, x, y), nearest_steps(self.fields.waves.goal, x, y)
        if max(path, goal) >= side * side:
            return INVALID
        nose_x, nose_y = x + w["nose"] * math.cos(heading), y + w["nose"] * math.sin(heading)
        if not (0 <= nose_x < side and 0 <= nose_y < side):
            return INVALID
        nose = [float(f[int(nose_y), int(nose_x)]) for f in (self.fields.waves.path, self.fields.waves.front)]
        nose = [
            a + math.sqrt(2) * w["nose"] if n >= side * side else n
            for n, a in zip(nose, (path, goal), strict=True)
        ]
        cost = self.table[min(int(least), len(self.table) - 1)]
        return float(
            cost + w["path"] * path + w["alignment"] * nose[0] + w["goal"] * goal + w["front"] * nose[1]
        )


SIDE = 40
REACH = 10
BASE: Numbers = {
    "path": 1.6, "alignment": 1.6, "goal": 0.6, "front": 0.6, "nose": 3.3, "horizon": 3.0, "stride": 1.0,
    "turn_stride": 0.1, "deceleration": 10.0, "stop_buffer": 0.2, "radius": 1.8, "padding": 0.45,
    "scaling_speed": 2.5, "scaling_range": 2.5, "scaling_factor": 0.2, "least_speed": 1.0, "least_turn": 0.4,
    "goal_distance": math.inf, "escape": 0.0,
}  # fmt: skip
"""The chapter's values on cells twice as large."""
FORWARD = np.array([0.0, 5.0, -1.0, 1.0])
FREE = np.zeros(4, np.bool_)
BOUNDLESS = np.empty((0, 3))


class Choice(NamedTuple):
    speed: float
    turn: float
    score: float


class Scene:
    """A window with marks, a plan to the east and a robot."""

    def __init__(self, seed: int, obstacles: int = 12) -> None:
        rng = np.random.default_rng(seed)
        self.pose = (*rng.uniform(16.0, 24.0, 2), rng.uniform(-3.1, 3.1))
        self.marks = np.zeros((SIDE, SIDE), np.uint8)
        self.marks[rng.integers(0, SIDE, obstacles), rng.integers(0, SIDE, obstacles)] = 1
        self.row = int(rng.integers(14, 26))
        self.table: Floats = np.linspace(6.0, 0.0, (REACH + 1) ** 2 + 1, dtype=np.float64)
        self.table.setflags(write=False)
        self.goal = (self.row, int(rng.integers(26, 40)))

    def fields(self, limit: float = 2.25**2, trusted: int = 1) -> CriticFields:
        squared = squared_within(self.marks, REACH)
        plan = np.array([(self.row, c) for c in range(18, self.goal[1] + 1)], np.int32)
        goal = np.array([self.goal], np.int32)
        front = np.array([(self.row, min(self.goal[1] + 3, SIDE - 1))], np.int32)
        known = np.full((SIDE, SIDE), trusted, np.uint8)
        waves = [wavefront(squared, limit, starts) for starts in (plan, goal, front)]
        return CriticFields(squared, Waves(*waves), known)

    def choose(
        self,
        weights: Numbers,
        window: Floats = FORWARD,
        counts: tuple[int, int] = (7, 8),
        barred: Flags = FREE,
        trusted: int = 1,
        bounds: Floats = BOUNDLESS,
    ) -> Choice:
        packed = np.array([tuple(weights[name] for name in WEIGHTS.names or ())], WEIGHTS)
        fields = self.fields(trusted=trusted)
        found = best_velocity(np.array(self.pose), window, counts, barred, bounds, fields, self.table, packed)
        return Choice(*found)


@settings(max_examples=60, deadline=None)
@example(seed=1437, goal_distance=math.inf, slowest=0.0)
@given(
    seed=st.integers(0, 10**6),
    goal_distance=st.sampled_from([math.inf, 6.3]),
    slowest=st.sampled_from([0.0, -2.0]),
)
def test_the_choice_equals_the_reference(seed: int, goal_distance: float, slowest: float) -> None:
    scene = Scene(seed)
    weights = {**BASE, "goal_distance": goal_distance}
    window = np.array([slowest, 5.0, -1.0, 1.0])
    choice = scene.choose(weights, window)
    twin = ReferenceDwa(scene.fields(), scene.marks != 0, scene.table, weights)
    valid = [t for t in twin.trajectories(scene.pose, window, (7, 8)) if t.score >= 0]
    if not valid:
        assert choice == (0.0, 0.0, INVALID)
        return
    # the kernel's distances are lower bounds of the reference's between two marks, so that it may reject what
    # the reference barely accepts
    clear = [t.score for t in valid if t.room > 0.5]
    if choice == (0.0, 0.0, INVALID):
        assert not clear
        return
    same = [t for t in valid if math.isclose(t.speed, choice.speed, abs_tol=1e-9) and
            math.isclose(t.turn, choice.turn, abs_tol=1e-9)]  # fmt: skip
    assert len(same) == 1
    assert choice.score == pytest.approx(same[0].score, abs=0.5)
    assert choice.score <= min(clear, default=math.inf) + 0.5


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    speed=st.tuples(st.floats(-3, 5), st.floats(0, 3)),
    turn=st.tuples(st.floats(-2, 2), st.floats(0, 1)),
    barred=st.lists(st.booleans(), min_size=4, max_size=4),
)
def test_a_choice_lies_in_the_window_is_fast_enough_and_not_barred(
    seed: int, speed: tuple[float, float], turn: tuple[float, float], barred: list[bool]
) -> None:
    window = np.array([speed[0], sum(speed), turn[0], sum(turn)])
    choice = Scene(seed, 3).choose(BASE, window, barred=np.array(barred))
    assume(choice.score >= 0)
    assert window[0] <= choice.speed <= window[1] and window[2] <= choice.turn <= window[3]
    assert abs(choice.speed) > 0.999 or abs(choice.turn) > 0.399
    signs = [choice.speed > 0, choice.speed < 0, choice.turn > 0, choice.turn < 0]
    assert not any(one and other for one, other in zip(signs, barred, strict=True))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), side=st.floats(-3.1, 3.1), room=st.floats(0.0, 3.0))
def test_after_a_choice_the_body_can_stop_within_its_bounds(seed: int, side: float, room: float) -> None:
    scene = Scene(seed, 3)
    bounds = np.array([[math.cos(side), math.sin(side), room]])
    choice = scene.choose(BASE, bounds=bounds)
    assume(choice.score >= 0)
    x, y, heading = 0.0, 0.0, scene.pose[2]
    length = choice.speed * BASE["stop_buffer"] + choice.speed**2 / (2 * BASE["deceleration"])
    for _ in range(1000):  # braking on the same arc
        x, y = x + length / 1000 * math.cos(heading), y + length / 1000 * math.sin(heading)
        heading += choice.turn * length / choice.speed / 1000 if choice.speed else 0.0
    assert x * bounds[0, 0] + y * bounds[0, 1] <= room + 0.02


def near(gap: float, heading: float = 0.0) -> Scene:
    """Return a robot at a distance west of a marked cell's centre, with a heading relative to it."""
    scene = Scene(1, 0)
    scene.marks[20, 20] = 1
    scene.pose = (20.5 - gap, 20.5, heading)
    scene.row, scene.goal = 10, (10, 36)
    return scene


def test_too_near_there_is_no_trajectory_unless_it_may_escape() -> None:
    for heading in (0.0, 3.1, -1.5):
        assert near(2.2, heading).choose(BASE) == (0.0, 0.0, INVALID)
        assert near(2.4, heading).choose(BASE).score >= 0
    weights = {**BASE, "escape": 1.0}
    assert near(1.9, math.pi).choose(weights).speed > 0
    ahead = near(1.9, 0.0).choose(weights)
    assert ahead.score >= 0 and ahead.speed == 0 and ahead.turn != 0
    assert near(1.9, 0.0).choose(weights, np.array([-2.0, 2.0, -0.1, 0.1])).speed < 0
    assert near(1.2, math.pi).choose(weights) == (0.0, 0.0, INVALID)


def test_it_backs_out_over_known_floor_only() -> None:
    backward = np.array([-2.0, -1.0, -0.1, 0.1])
    assert near(4.0).choose(BASE, backward).score >= 0
    assert near(4.0).choose(BASE, backward, trusted=0) == (0.0, 0.0, INVALID)
