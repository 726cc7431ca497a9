"""The kernel against its twin and the original, and what a choice must be like whatever stands around."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.robot.cost_maps.cell_distance import squared_within
from actors.robot.cost_maps.footprint import outline
from actors.robot.cost_maps.inflation import Inflation
from actors.robot.local_planning.dwa import CRITICS, INVALID, CheapestVelocity, Singles, cheapest, samples
from actors.robot.local_planning.map_grid import wavefront
from benchmarks import navigation as original
from tests.navigation.dwa_twin import Numbers, Twin

SIDE, CELL = 40, 0.1
INFLATION = Inflation(0.186, 0.75, 15.0)
TABLE = INFLATION.table(CELL)
OUTLINE = outline(0.18, 0.01) / CELL
NUMBERS: Numbers = {
    "obstacle": 0.05, "front": 1.2, "alignment": 3.2, "path": 3.2, "goal": 1.2, "nose": 3.25, "cell": CELL,
    "horizon": 3.0, "stride": 0.05, "turn_stride": 0.1,
    "least_speed": 0.1, "least_turn": 0.4, "most_speed": 0.5,
}  # fmt: skip
FREE = np.zeros(4, np.bool_)
ROWS = Path(__file__).parent / "original"


class Scene:
    """A window with some marked cells, a plan to the east and a robot; its corner is the frame's origin."""

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
        self.twin = Twin(TABLE[squared], self.path, self.goal, self.front, OUTLINE, NUMBERS)

    def choose(self, speeds: Singles, turns: Singles, barred: NDArray[np.bool_] = FREE) -> CheapestVelocity:
        critics = np.array([tuple(NUMBERS[name] for name in CRITICS.names or ())], CRITICS)
        pose = np.array([*self.pose, 0.0, 0.0])
        around = self.squared, self.path, self.goal, self.front
        return CheapestVelocity(*cheapest(pose, speeds, turns, barred, *around, TABLE, OUTLINE, critics))

    def costs(self, speeds: Singles, turns: Singles) -> dict[tuple[float, float], float]:
        """By the twin, of valid trajectories that are fast enough."""
        x, y, heading = self.pose
        found = {}
        for speed in map(float, speeds):
            for turn in map(float, turns):
                fast = speed + 1e-4 >= NUMBERS["least_speed"] or abs(turn) + 1e-4 >= NUMBERS["least_turn"]
                cost = self.twin.cost((x / CELL, y / CELL, heading), speed, turn) if fast else None
                if cost is not None:
                    found[speed, turn] = cost
        return found


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    obstacles=st.integers(0, 40),
    speed=st.tuples(st.floats(0, 0.4), st.floats(0, 0.4)),
    turn=st.tuples(st.floats(-2, 2), st.floats(0, 1)),
)
def test_the_choice_is_the_twins(
    seed: int, obstacles: int, speed: tuple[float, float], turn: tuple[float, float]
) -> None:
    scene = Scene(seed, obstacles)
    speeds = samples(speed[0], min(sum(speed), 0.5), 6)
    turns = samples(turn[0], sum(turn), 7)
    choice, costs = scene.choose(speeds, turns), scene.costs(speeds, turns)
    if not costs:
        assert choice == (0.0, 0.0, INVALID)
        return
    # a point that is within rounding of a cell's border may be in the other one
    assert choice.cost == pytest.approx(min(costs.values()), abs=1e-9)
    assert costs[choice.speed, choice.turn] == pytest.approx(choice.cost, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), barred=st.lists(st.booleans(), min_size=4, max_size=4))
def test_a_choice_is_fast_enough_and_not_barred(seed: int, barred: list[bool]) -> None:
    choice = Scene(seed, 6).choose(samples(-0.3, 0.5, 7), samples(-1.0, 1.0, 8), np.array(barred))
    if choice.cost == INVALID:
        return
    assert abs(choice.speed) >= 0.1 - 1e-4 or abs(choice.turn) >= 0.4 - 1e-4
    along, back, left, right = barred
    assert not (choice.speed > 0 and along) and not (choice.speed < 0 and back)
    assert not (choice.turn > 0 and left) and not (choice.turn < 0 and right)


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
def test_it_chooses_as_the_original_chose(capsys: pytest.CaptureFixture[str]) -> None:
    """Ninety cycles of three of its logs; what differs is a point or two on the border between two cells."""
    measured = original.check(ROWS)
    measured.show()
    found = measured.figures
    assert found["all"]["cycles"] == 90 and found["inflation"]["cells"] == 89_600
    assert found["all"]["same"] >= 0.97 and found["all"]["within_one"] >= 0.98
    assert found["all"]["regret_90"] <= 0.001 and found["all"]["refused"] == 0.0
    assert (found["all"]["only_ours"], found["all"]["only_theirs"]) == (0, 0)
    assert found["inflation"]["equal"] >= 0.999
    assert {name: one["pairs"] for name, one in found["plans"].items()} == dict.fromkeys(found["plans"], 6)
    assert sorted(found["plans"]) == ["apartment", "corridor", "maze"]
    files = found["files"]
    assert sorted(files) == ["local_apartment_4_s4", "local_corridor_4_s7", "local_maze_1_s3"]
    categories = ("free", "near_goal", "turning")
    for name in ("all", *categories):
        assert sum(one[name]["cycles"] for one in files.values()) == found[name]["cycles"], name
    of_one = files["local_maze_1_s3"]
    assert sum(of_one[name]["cycles"] for name in categories) == of_one["all"]["cycles"] == 30
    row = next(line for line in capsys.readouterr().out.splitlines() if "local_maze_1_s3" in line)
    assert all(f"{of_one[name]['same']:.1%}, " in row for name in categories)


def refused(folder: Path) -> str:
    with pytest.raises(original.RowsError) as caught:
        original.check(folder)
    return str(caught.value)


def test_a_folder_without_rows_is_refused(tmp_path: Path) -> None:
    assert refused(tmp_path) == f"{tmp_path}: holds no local_*.npz; must be a folder of rows of the original"


def test_files_that_hold_something_else_are_refused_in_a_sentence(tmp_path: Path) -> None:
    """Whoever sends rows may send anything: no zip, half of one, arrays that are missing or do not fit."""
    name, whole = tmp_path / "local_a.npz", (ROWS / "local_maze_1_s3.npz").read_bytes()
    flipped = bytes(255 - byte if k == 20_000 else byte for k, byte in enumerate(whole))
    for damaged in (b"no rows", b"", whole[:-900], whole[:30_000], flipped):
        name.write_bytes(damaged)
        assert refused(tmp_path).startswith(f"{name}: cannot be compared: ")
    with np.load(ROWS / "local_maze_1_s3.npz") as found:
        rows = dict(found)
    np.savez(name, time=np.zeros(1))
    assert refused(tmp_path) == f"{name}: lacks 'plan_points'; must hold the rows of the original"
    changes: list[tuple[str, object]] = [
        ("costs", rows["costs"][:, :20]), ("plan", rows["plan"] + 99), ("pose_map", rows["pose_map"][:, :2]),
        ("pose_odometry", rows["pose_odometry"] * math.nan), ("plan_points", rows["plan_points"] * math.inf),
        ("category", rows["category"][:3]), ("vx", rows["vx"][0]), ("corner", rows["corner"][:, :1]),
    ]  # fmt: skip
    for array, changed in changes:
        np.savez(name, **{**rows, array: changed})
        assert refused(tmp_path).startswith(f"{name}: cannot be compared: "), array


def test_plans_and_costs_of_something_else_are_refused_too(tmp_path: Path) -> None:
    (tmp_path / "local_a.npz").write_bytes((ROWS / "local_maze_1_s3.npz").read_bytes())
    for name, array in (("global_maze.npz", "goals"), ("inflation.npz", "costs_local")):
        with np.load(ROWS / name) as found:
            np.savez(tmp_path / name, **{**found, array: found[array][:2]})
        assert refused(tmp_path).startswith(f"{tmp_path / name}: cannot be compared: ")
        (tmp_path / name).unlink()
