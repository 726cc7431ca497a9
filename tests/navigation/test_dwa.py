"""The kernel compared with a reference and with recordings of the original."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acrc_testbed.benchmarks import navigation as original
from actors.array_types import Flags, Floats, Int32s, Octets, Singles
from actors.robot.navigation.cost_map import Inflation
from actors.robot.navigation.dwa import CRITICS, INVALID, CheapestVelocity, cheapest_velocity, samples
from actors.robot.navigation.map_grid import Waves, wavefront
from actors.robot.navigation.ray_tracing import outline, squared_within

Numbers = dict[str, float]
Cell = tuple[int, int]


@dataclass
class ReferenceDwa:
    costs: Octets
    path: Int32s
    goal: Int32s
    front: Int32s
    outline: Floats
    w: Numbers

    def cost(self, pose: tuple[float, float, float], speed: float, turn: float) -> float | None:
        highest = 0
        for x, y, heading in self._points(pose, speed, turn):
            below, cell = self._below(x, y, heading), self._cell(x, y)
            nose = self._cell(x + self.w["nose"] * math.cos(heading), y + self.w["nose"] * math.sin(heading))
            if below is None or cell is None or nose is None:
                return None
            if max(self.path[cell], self.goal[cell]) >= self.costs.size:
                return None
            highest = max(below, int(self.costs[cell]))
        assert cell is not None and nose is not None
        return (
            self.w["obstacle"] * highest
            + self.w["front"] * int(self.front[nose])
            + self.w["alignment"] * int(self.path[nose])
            + self.w["path"] * int(self.path[cell])
            + self.w["goal"] * int(self.goal[cell])
        )

    def _points(
        self, pose: tuple[float, float, float], speed: float, turn: float
    ) -> Iterator[tuple[float, float, float]]:
        w = self.w
        count = math.ceil(
            max(abs(speed) * w["horizon"] / w["stride"], abs(turn) * w["horizon"] / w["turn_stride"])
        )
        x, y, heading = pose
        for _ in range(count):
            yield x, y, heading
            ahead = speed / w["cell"] * w["horizon"] / count
            x, y = x + ahead * math.cos(heading), y + ahead * math.sin(heading)
            heading += turn * w["horizon"] / count

    def _cell(self, x: float, y: float) -> Cell | None:
        rows, columns = self.costs.shape
        return (int(y), int(x)) if 0 <= x < columns and 0 <= y < rows else None

    def _below(self, x: float, y: float, heading: float) -> int | None:
        """Return the highest cost below the outline; None if it is lethal or outside the window."""
        c, s = math.cos(heading), math.sin(heading)
        corners = [self._cell(x + a * c - b * s, y + a * s + b * c) for a, b in self.outline]
        highest = 0
        for here, there in zip(corners, corners[1:] + corners[:1], strict=True):
            if here is None or there is None:
                return None
            highest = max([highest, *(int(self.costs[cell]) for cell in line(here, there))])
        return None if highest == 254 else highest


def line(here: Cell, there: Cell) -> list[Cell]:
    (row, column), up, right = here, there[0] - here[0], there[1] - here[1]
    length = max(abs(up), abs(right))
    cells = []
    for k in range(length + 1):
        # number of steps along the shorter axis in k steps, with an initial remainder of half of the longer
        across = (length // 2 + k * min(abs(up), abs(right))) // max(length, 1)
        along_row, along_column = (across, k) if abs(right) >= abs(up) else (k, across)
        up_now, right_now = math.copysign(along_row, up), math.copysign(along_column, right)
        cells.append((row + int(up_now), column + int(right_now)))
    return cells


SIDE, CELL = 40, 0.1
INFLATION = Inflation(0.186, 0.75, 15.0)
TABLE = INFLATION.table(CELL)
OUTLINE = outline(0.18, 0.01) / CELL
NUMBERS: Numbers = {
    "obstacle": 0.05, "front": 1.2, "alignment": 3.2, "path": 3.2, "goal": 1.2, "nose": 3.25, "cell": CELL,
    "horizon": 3.0, "stride": 0.05, "turn_stride": 0.1,
    "least_speed": 0.1, "least_turn": 0.4, "most_speed": 0.5,
}  # fmt: skip
ROWS = Path(__file__).parent / "original"


class Scene:
    """A window with marks, a plan to the east and a robot; its corner is the frame's origin."""

    def __init__(self, seed: int, obstacles: int = 12) -> None:
        rng = np.random.default_rng(seed)
        x, y, heading = rng.uniform((1.6, 1.6, -3.1), (2.4, 2.4, 3.1)).astype(np.float32).tolist()
        self.pose = x, y, heading
        marks = np.zeros((SIDE, SIDE), np.uint8)
        marks[rng.integers(0, SIDE, obstacles), rng.integers(0, SIDE, obstacles)] = 1
        squared = squared_within(marks, INFLATION.reach(CELL))
        row, last = int(rng.integers(14, 26)), int(rng.integers(26, 40))
        plan = np.array([(row, column) for column in range(18, last + 1)], np.int32)
        goal, front = plan[-1:], np.array([(row, min(last + 3, SIDE - 1))], np.int32)
        limit = (INFLATION.inscribed / CELL) ** 2
        self.squared = squared
        self.path, self.goal, self.front = (wavefront(squared, limit, cells) for cells in (plan, goal, front))
        self.twin = ReferenceDwa(TABLE[squared], self.path, self.goal, self.front, OUTLINE, NUMBERS)

    def choose(self, speeds: Singles, turns: Singles, barred: Flags) -> CheapestVelocity:
        critics = np.array([tuple(NUMBERS[name] for name in CRITICS.names or ())], CRITICS)
        pose = np.array([*self.pose, 0.0, 0.0])
        around = self.squared, Waves(self.path, self.goal, self.front)
        return CheapestVelocity(
            *cheapest_velocity(pose, speeds, turns, barred, *around, TABLE, OUTLINE, critics)
        )

    def costs(self, speeds: Singles, turns: Singles, barred: Flags) -> dict[tuple[float, float], float]:
        x, y, heading = self.pose
        found = {}
        for speed in map(float, speeds):
            for turn in map(float, turns):
                fast = speed + 1e-4 >= NUMBERS["least_speed"] or abs(turn) + 1e-4 >= NUMBERS["least_turn"]
                allowed = not np.any(barred & [speed > 0, speed < 0, turn > 0, turn < 0])
                cost = (
                    self.twin.cost((x / CELL, y / CELL, heading), speed, turn) if fast and allowed else None
                )
                if cost is not None:
                    found[speed, turn] = cost
        return found


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    obstacles=st.integers(0, 40),
    speed=st.tuples(st.floats(0, 0.4), st.floats(0, 0.4)),
    turn=st.tuples(st.floats(-2, 2), st.floats(0, 1)),
    barred=st.just([False] * 4) | st.lists(st.booleans(), min_size=4, max_size=4),
)
def test_the_choice_equals_the_reference(
    seed: int, obstacles: int, speed: tuple[float, float], turn: tuple[float, float], barred: list[bool]
) -> None:
    scene, signs = Scene(seed, obstacles), np.array(barred)
    speeds = samples(speed[0], min(sum(speed), 0.5), 6)
    turns = samples(turn[0], sum(turn), 7)
    choice, costs = scene.choose(speeds, turns, signs), scene.costs(speeds, turns, signs)
    if not costs:
        assert choice == (0.0, 0.0, INVALID)
        return
    # a point that is within rounding of a cell's border may be in the other one
    assert choice.cost == pytest.approx(min(costs.values()), abs=1e-9)
    assert costs[choice.speed, choice.turn] == pytest.approx(choice.cost, abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(low=st.floats(-5, 5, width=32), span=st.floats(0, 5, width=32), count=st.integers(2, 30))
def test_samples_are_even_and_hold_both_ends_and_zero(low: float, span: float, count: int) -> None:
    high = float(np.float32(low + span))
    values = samples(low, high, count).tolist()
    assert values[0] == np.float32(low) and values[-1] == np.float32(high) and values == sorted(values)
    assert len(values) <= count + 1 and (high == low) == (len(values) == 1)
    if low < -1e-3 and high > 1e-3:
        assert 0.0 in values or min(map(abs, values)) < 1e-6
    steps = np.diff([value for value in values if value != 0.0 or len(values) == count])
    assert all(step <= 2.01 * (high - low) / (count - 1) + 1e-6 for step in steps)


@pytest.mark.claim("navigation")
def test_it_chooses_as_the_original_chose() -> None:
    """Ninety cycles of three recordings; differences are single points on the border of two cells."""
    found = original.check(ROWS).figures
    assert found["all"]["cycles"] == 90 and found["inflation"]["cells"] == 89_600
    assert found["all"]["same"] >= 0.97 and found["all"]["within_one"] >= 0.98
    assert found["all"]["regret_90"] <= 0.001 and found["all"]["refused"] == 0.0
    assert (found["all"]["only_ours"], found["all"]["only_theirs"]) == (0, 0)
    assert found["inflation"]["equal"] >= 0.999
    assert {name: one["pairs"] for name, one in found["plans"].items()} == dict.fromkeys(found["plans"], 6)
    assert sorted(found["plans"]) == ["apartment", "corridor", "maze"]
    categories = ("free", "near_goal", "turning")
    for name in ("all", *categories):
        assert sum(one[name]["cycles"] for one in found["files"].values()) == found[name]["cycles"], name
    of_one = found["files"]["local_maze_1_s3"]
    assert sum(of_one[name]["cycles"] for name in categories) == of_one["all"]["cycles"] == 30


def refused(folder: Path) -> str:
    with pytest.raises(original.ReferenceDataError) as caught:
        original.check(folder)
    return str(caught.value)


def test_other_rows_are_rejected(tmp_path: Path) -> None:
    assert refused(tmp_path) == f"{tmp_path}: contains no local_*.npz; give a folder of reference data"
    name, whole = tmp_path / "local_a.npz", (ROWS / "local_maze_1_s3.npz").read_bytes()
    flipped = bytes(255 - byte if k == 20_000 else byte for k, byte in enumerate(whole))
    for damaged in (b"no rows", b"", whole[:30_000], flipped):
        name.write_bytes(damaged)
        assert refused(tmp_path).startswith(f"{name}: cannot be compared: ")
    with np.load(ROWS / "local_maze_1_s3.npz") as found:
        rows = dict(found)
    np.savez(name, time=np.zeros(1))
    assert refused(tmp_path) == f"{name}: array 'plan_points' is missing; give reference data"
    changes: list[tuple[str, object]] = [
        ("costs", rows["costs"][:, :20]), ("plan", rows["plan"] + 99), ("category", rows["category"][:3]),
        ("plan_points", rows["plan_points"] * math.inf), ("vx", rows["vx"][0]),
    ]  # fmt: skip
    for array, changed in changes:
        np.savez(name, **{**rows, array: changed})
        assert refused(tmp_path).startswith(f"{name}: cannot be compared: "), array
    name.write_bytes(whole)
    for other, array in (("global_maze.npz", "goals"), ("inflation.npz", "costs_local")):
        with np.load(ROWS / other) as found:
            np.savez(tmp_path / other, **{**found, array: found[array][:2]})
        assert refused(tmp_path).startswith(f"{tmp_path / other}: cannot be compared: ")
        (tmp_path / other).unlink()
