"""Gap between field trial and simulation: estimators on data of known values, and planted differences."""

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from acrc_testbed.experiments import gap_report, reality_gap
from acrc_testbed.experiments.gap_report import FittedKey, GapReport, KeyFit, compare_field, key_fits
from acrc_testbed.experiments.reality_gap import Quantity
from acrc_testbed.experiments.scan_poses import Keyframe, ScanMatcher
from acrc_testbed.results.field_recordings import RecordedMessage, RobotIdentity, RobotLog, Tick
from actors.array_types import Floats, UInt16s
from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Point, Pose
from actors.installation.repository import REPOSITORY
from actors.messages import Drive, Odometry, SensorData
from actors.radio.radio_model import RadioSetup, radio_model
from actors.robot_model import DriveParameters, RobotModel, load_model
from actors.runtime.errors import AcrcError
from actors.world.sensing import RangeSensors
from tests.field_trial.runs import clock, copies
from tests.in_process import acrc
from tests.recorded_runs import HEAD_ON, record

STEP_US = 100_000
DRIVE = DriveParameters("differential", speed=0.5, acceleration=1.0, turn_rate=5.0, turn_acceleration=3.5)
FILE = REPOSITORY / "actors" / "models" / "turtlebot2.toml"
MODEL = load_model("turtlebot2")
RADIO = radio_model(
    RadioSetup(seed=1, step_us=STEP_US, robots=(("r1", 1), ("r2", 2)), preset="chapter", walls="air")
)


def driven(seed: int, drive: DriveParameters, seconds: int = 120) -> RobotLog:
    """Return the log of a base that follows random commands, integrated every millisecond.

    As with a Kobuki, the base reports speeds with the resolution of its encoders over 20 ms.
    """
    rng, steps = np.random.default_rng(seed), 10 * seconds
    holds = rng.integers(2, 12, steps)
    speeds, rates = (np.repeat(rng.uniform(-1, 1, steps), holds)[:steps] for _ in range(2))
    orders = np.column_stack((0.5 * np.abs(speeds), 2.0 * rates))
    most = np.array((drive.acceleration, drive.turn_acceleration)) * 1e-3
    late = round(drive.delay * 1e3)
    log, velocity, pose = (
        RobotLog(Path("r1.mcap"), RobotIdentity("r1", 0, 1, STEP_US), senses=[]),
        np.zeros(2),
        0,
    )
    assert log.senses is not None
    for step in range(steps):
        noisy = np.round(velocity / (0.0043, 0.0087)) * (0.0043, 0.0087)
        odometry = Odometry(pose, 0.0, 0.0, float(noisy[0]), 0.0, float(noisy[1]))
        log.ticks.append(Tick(step, step * STEP_US))
        log.senses.append(SensorData(step, step * STEP_US, 0, odometry, 0))
        vx, omega = orders[step].tolist()
        log.messages.append(RecordedMessage(step, "", Drive(step, vx, 0.0, omega, 0)))
        for millisecond in range(100 * step, 100 * step + 100):
            target = orders[max(millisecond - late, 0) // 100].clip(
                (-drive.speed, -drive.turn_rate), (drive.speed, drive.turn_rate)
            )
            velocity = velocity + (target - velocity).clip(-most, most)
    return log


@pytest.fixture(scope="module")
def base() -> dict[str, Quantity]:
    """Return the quantities of the simulation's drive."""
    return {one.name: one for one in reality_gap.drive_quantities([driven(2, DRIVE)], DRIVE)}


@pytest.mark.parametrize(
    "changes",
    [{"acceleration": 0.7, "delay": 0.08}, {"speed": 0.35, "turn_acceleration": 2.0}, {}],
    ids=str,
)
def test_planted_differences_of_the_drive_are_found_and_no_others(
    changes: dict[str, float], base: dict[str, Quantity]
) -> None:
    log, late = driven(1, msgspec.structs.replace(DRIVE, **changes)), base["command delay"].best()
    field = {one.name: one for one in reality_gap.drive_quantities([log], DRIVE, late)}
    keys = [one for one in gap_report.compared_keys(MODEL, RADIO) if one.key.startswith("drive.")]
    found = {one.key: one for one in key_fits(field, base, keys)}
    nearer = {key.removeprefix("drive."): fit for key, fit in found.items() if fit.verdict == "nearer"}
    assert nearer.keys() == changes.keys()
    for key, value in changes.items():
        fit = nearer[key]
        assert fit.fitted == pytest.approx(value, abs=0.1 * abs(value - fit.simulated))


def room(side: float = 8.0) -> OccupancyGrid:
    """Return a square room around the origin with a pillar."""
    cells = np.full((round(side / 0.05),) * 2, FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[100:110, 30:40] = OCCUPIED
    return OccupancyGrid(cells, 0.05, Point(-side / 2, -side / 2))


def scanner(grid: OccupancyGrid, model: RobotModel) -> Callable[[Pose], UInt16s]:
    """Return a function from a pose to a scan there."""
    sensors = RangeSensors(grid, [model], [np.random.default_rng(1)])

    def scan(pose: Pose) -> UInt16s:
        return sensors.scan([0], np.array(pose)[None], np.zeros((0, 3)))[0]

    return scan


def test_a_scan_determines_the_pose_and_the_noise_of_the_sensor() -> None:
    noisy, rng = MODEL.with_sensor(noise=0.02), np.random.default_rng(2)
    matcher, scan = ScanMatcher(room(), noisy), scanner(room(), noisy)
    residuals = []
    for x, y, heading, *wrong in rng.uniform(-1, 1, (20, 6)).tolist():
        pose = Pose(2 * x, 2 * y, 3 * heading)
        guess = pose.compose(Pose(0.2 * wrong[0], 0.2 * wrong[1], 0.1 * wrong[2]))
        match = matcher.match(guess, scan(pose))
        assert match is not None
        assert math.dist(match[0][:2], pose[:2]) < 0.015
        assert match[0].relative(pose).heading == pytest.approx(0.0, abs=0.005)
        residuals.append(match[1])
    frames = [Keyframe(float(k), Pose(0, 0, 0), Pose(0, 0, 0), one) for k, one in enumerate(residuals)]
    noise = next(iter(reality_gap.scan_quantities([frames])))
    assert noise.total() == pytest.approx(0.02, rel=0.05)


def test_a_scan_along_a_featureless_corridor_or_of_another_place_determines_no_pose() -> None:
    cells = np.full((40, 1000), FREE, np.uint8)
    cells[[0, -1]] = OCCUPIED
    corridor = OccupancyGrid(cells, 0.05, Point(-25.0, -1.0))
    middle, aside = Pose(0.0, 0.0, 0.0), Pose(0.1, 0.1, 0.1)
    assert ScanMatcher(corridor, MODEL).match(aside, scanner(corridor, MODEL)(middle)) is None
    assert ScanMatcher(room(), MODEL).match(aside, scanner(room(3.0), MODEL)(middle)) is None


def test_odometry_is_measured_against_the_poses_of_scans() -> None:
    rng = np.random.default_rng(3)
    place, frames = Pose(0.0, 0.0, 0.0), []
    measured = Pose(1.0, 2.0, 1.0)  # in its own frame
    for second in range(100):
        x, y = (np.array(place[:2]) + rng.normal(0, 0.003, 2)).tolist()
        frames.append(Keyframe(float(second), measured, Pose(x, y, place.heading), np.zeros(1)))
        step, turn = float(rng.uniform(0.1, 0.5)), float(rng.normal(0, 0.3))
        place, measured = place.compose(Pose(step, 0, turn)), measured.compose(Pose(1.03 * step, 0, turn))
    found = {one.name: one for one in reality_gap.scan_quantities([frames])}
    assert found["odometry scale"].total() == pytest.approx(1.03, abs=0.002)
    assert found["odometry drift"].total() == pytest.approx(0.03, abs=0.01)


def receptions(loss_db: float, count: int = 400) -> Floats:
    """Return frames over 1 to 12 m under an additional loss, with the chip's least signal strength."""
    rng = np.random.default_rng(4)
    rows = np.zeros((count, 6))
    rows[:, 0], rows[:, 3] = np.arange(count) / 2, rng.uniform(1, 12, count)
    for row in rows:
        expected = -10.0 - RADIO.propagation.loss_db(row[None, 1:3], row[None, 3:5]).item() - loss_db
        expected += rng.normal(0, 2.0)
        row[5] = max(expected, -90.0) if expected > -95.0 else math.nan
    return rows


def test_a_loss_is_found_although_weak_frames_are_reported_as_minus_90_dbm_or_not_heard() -> None:
    for loss_db in (0.0, 6.0):
        found = {one.name: one for one in reality_gap.radio_quantities(receptions(loss_db), RADIO)}
        assert found["path loss beyond the model"].total() == pytest.approx(loss_db, abs=0.6)
    heard = receptions(6.0)
    near = (heard[:, 3] >= 2.0) & (heard[:, 3] < 4.0)
    share = np.isfinite(heard[near, 5]).mean()
    assert found["frames heard, 2 to 4 m"].total() == pytest.approx(share)
    assert not len(found["frames heard, above 16 m"].blocks)


def test_a_share_of_nothing_is_too_little_data() -> None:
    found = gap_report._gap(Quantity("q", "", np.zeros((9, 2))), Quantity("q", "", np.ones((9, 2))))
    assert math.isnan(found.field)
    assert math.isnan(found.difference)
    assert (found.simulated, found.interval) == (1.0, None)


KEY = FittedKey("q", "some.key", 1.0, 0.1)


def medians(rng: np.random.Generator, middle: float, blocks: int = 30) -> dict[str, Quantity]:
    """Return a quantity fitted to ten normal values per block."""
    candidates = np.arange(-3.0, 5.0, 0.05, np.float64)
    values = rng.normal(middle, 1.0, (blocks, 10))
    return {"q": Quantity("q", "", np.abs(values[..., None] - candidates).sum(axis=1), candidates)}


def test_equal_distributions_give_a_nearer_value_in_at_most_the_stated_share() -> None:
    """A tolerance of three standard deviations of 300 trials beyond 2.5 %: only one direction counts."""
    rng = np.random.default_rng(5)
    verdicts = [next(key_fits(medians(rng, 0), medians(rng, 0), [KEY])).verdict for _ in range(300)]
    assert verdicts.count("nearer") <= 300 * 0.025 + 3 * math.sqrt(300 * 0.025)


def test_intervals_of_the_difference_cover_the_true_one() -> None:
    rng, covered = np.random.default_rng(6), 0
    for _ in range(150):
        gap = gap_report._gap(medians(rng, 1.0)["q"], medians(rng, 0.0)["q"])
        assert gap.interval is not None
        covered += gap.interval[0] <= 1.0 <= gap.interval[1]
    assert 0.90 <= covered / 150 <= 0.99


def test_fits_of_few_blocks_say_so_and_small_ones_are_not_reported() -> None:
    rng = np.random.default_rng(7)

    def verdict(middle: float, blocks: int) -> KeyFit:
        return next(key_fits(medians(rng, middle, blocks), medians(rng, 0.0), [KEY]))

    few, undecided, found = verdict(2.0, 7), verdict(2.0, 10), verdict(2.0, 40)
    assert (few.verdict, few.p) == ("too little data", None)
    assert math.isnan(few.fitted)
    assert (undecided.verdict, undecided.p) == ("too little data", None)
    assert found.verdict == "nearer"
    assert found.fitted == pytest.approx(3.0, abs=0.3)
    small = key_fits(medians(rng, 0.5, 400), medians(rng, 0.0, 400), [KEY._replace(least=1.0)])
    assert next(small).verdict == "as simulated"


def as_trial(run: Path, to: Path) -> Path:
    """Copy the recordings that robots on hardware would have, by their own clocks, with their maps."""
    copies(run, to, {"r1": clock(5_000_000, 20.0), "r2": clock(-3_000_000)})
    for robot in ("r1", "r2"):
        for file in (run / robot).glob("map.*"):
            shutil.copy(file, to / robot)
    return to


def test_a_short_trial_is_compared_and_lacks_data(short_run: Path, tmp_path: Path) -> None:
    done = acrc("gap", as_trial(short_run, tmp_path / "trial"), short_run, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["robots"] == ["r1", "r2"]
    assert {one["verdict"] for one in found["keys"]} == {"too little data"}
    assert "too little data" in acrc("gap", tmp_path / "trial", short_run).stdout


def test_wrong_folders_are_refused_in_one_sentence(short_run: Path, tmp_path: Path) -> None:
    trial = as_trial(short_run, tmp_path / "trial")
    with pytest.raises(AcrcError, match="RUN must be a simulated run"):
        compare_field(trial, trial)
    with pytest.raises(AcrcError, match="no such folder"):
        compare_field(tmp_path / "none", short_run)
    with pytest.raises(AcrcError, match="does not exist"):
        compare_field(trial, tmp_path / "none")
    maze = REPOSITORY / "maps" / "maze"
    for robot in ("r1", "r2"):
        for suffix in ("yaml", "png"):
            shutil.copy(maze.with_suffix(f".{suffix}"), trial / robot / f"maze.{suffix}")
        (trial / robot / "maze.yaml").rename(trial / robot / "map.yaml")
    with pytest.raises(AcrcError, match="its map differs"):
        compare_field(trial, short_run)


def test_other_robots_tasks_and_sensors_are_refused(short_run: Path, tmp_path: Path) -> None:
    record(tmp_path / "one", REPOSITORY / "scenarios" / "corridor.toml", robots=3, duration=0.5)
    for robot in ("r1", "r2"):
        shutil.rmtree(tmp_path / "one" / robot)
    with pytest.raises(AcrcError, match=r"its robots are r3, those of .* r1, r2; at least one"):
        compare_field(tmp_path / "one", short_run)
    record(tmp_path / "other", REPOSITORY / "scenarios" / "logistics.toml", duration=0.5)
    with pytest.raises(AcrcError, match=r"the task is 'logistics.task:Logistics', but 'cleaning\."):
        compare_field(tmp_path / "other", short_run)
    (tmp_path / "few.toml").write_text(FILE.read_text().replace("rays = 640", "rays = 360"))
    text = HEAD_ON.read_text().replace("[robots]\n", f'[robots]\nmodel = "{tmp_path}/few.toml"\n')
    record(tmp_path / "lidar", text, duration=0.5)
    with pytest.raises(AcrcError, match="rays, but the simulated sensor chapter"):
        compare_field(tmp_path / "lidar", short_run)


MORE = {
    '"odometry"': '"chapter"',
    "per_robot = 3": "per_robot = 6",
    "[12.4, 13.0]]": "[12.4, 13.0], [10.0, 11.6], [14.0, 12.4], [11.0, 13.0]]",
}
"""Changes of the scenario: localisation by scans, and twice as many places."""
PLANTED = {
    "drive.acceleration": 0.7, "drive.delay": 0.08, "radio.excess_db": 30.5, "kobuki_errors.wheel_bias": 0.03,
    "sensors.chapter.noise": 0.02,
}  # fmt: skip


def swarm_run(out: Path, seed: int, planted: dict[str, float]) -> Path:
    """Record a run with wheel odometry whose robot model and radio have these values."""
    file = FILE.read_text().replace('odometry = "exact"', 'odometry = "kobuki"') + "\n[kobuki_errors]\n"
    for key, value in planted.items():
        table, _, name = key.rpartition(".")
        kept = [line for line in file.splitlines() if not line.startswith(f"{name} = ")]
        file = "\n".join(kept).replace(f"[{table}]", f"[{table}]\n{name} = {value}") + "\n"
    model = out.parent / f"{out.name}.toml"
    model.write_text(file)
    radio = f"\n[radio]\nexcess_db = {planted.get('radio.excess_db', 24.5)}\n"
    text = HEAD_ON.read_text().replace("[robots]\n", f'[robots]\nmodel = "{model}"\n')
    for before, after in MORE.items():
        text = text.replace(before, after)
    record(out, text + radio, seed=seed)
    return out


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the simulated run."""
    return swarm_run(tmp_path_factory.mktemp("gap") / "simulated", 1, {})


def nearer(report: GapReport) -> dict[str, float]:
    """Return the values that bring the simulation nearer."""
    return {one.key: one.fitted for one in report.keys if one.verdict == "nearer"}


@pytest.mark.nightly
@pytest.mark.parametrize("keys", [(key,) for key in PLANTED] + [tuple(PLANTED)], ids=", ".join)
def test_differences_planted_in_a_whole_swarm_are_found_within_20_percent(
    keys: tuple[str, ...], simulated: Path, tmp_path: Path
) -> None:
    planted = {key: PLANTED[key] for key in keys}
    trial = as_trial(swarm_run(tmp_path / "field", 2, planted), tmp_path / "trial")
    report = compare_field(trial, simulated)
    found = nearer(report)
    assert found.keys() == planted.keys()
    for key, value in planted.items():
        base = next(one.simulated for one in report.keys if one.key == key)
        assert found[key] == pytest.approx(value, abs=0.2 * abs(value - base))


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [2, 3, 4, 5])
def test_no_key_differs_between_two_runs_of_equal_settings(
    seed: int, simulated: Path, tmp_path: Path
) -> None:
    trial = as_trial(swarm_run(tmp_path / "field", seed, {}), tmp_path / "trial")
    assert nearer(compare_field(trial, simulated)) == {}
