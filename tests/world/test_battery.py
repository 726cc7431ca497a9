"""Batteries: energies in closed form, conservation, empty robots, chargers, and model files."""

import json
import math
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

from acrc_testbed.experiments.metrics import task_metrics, value_of
from acrc_testbed.export import table_rows
from acrc_testbed.picture import run_page
from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.run_model.recording_readers import messages_on
from acrc_testbed.run_model.simulated_runs import read_run
from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import TRUTH, Odometry, RadioAdvanced, RobotTruth, SensorData, Truth
from actors.orders import Move, Restart
from actors.robot.behaviour.node_host import host, node_of
from actors.robot.behaviour.ports import BatteryMeter, Start, View
from actors.robot_model import load_model
from actors.runtime.codec import encode
from actors.runtime.errors import AcrcError
from actors.topic import Message
from actors.world.battery import Batteries, EnergyReport
from deeco import Knowledge, component, periodic, replace, role, seconds
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import parse
from tests.conduct.scripted_swarm import ScriptedSwarm
from tests.recorded_runs import HEAD_ON, record
from tests.refusals import refused

CAPACITY_J = 14.8 * 2.2 * 3600
ELECTRONICS, SENSOR, RECEIVING, TRANSMITTING = 9.2, 5.1, 0.063, 0.076
IDLE = ELECTRONICS + SENSOR + RECEIVING
SECONDS = 5.0
STILL = (0.0, 0.0)


def run_of(v: float, omega: float, seconds: float = SECONDS, charge: float | None = 0.5) -> ScriptedSwarm:
    return ScriptedSwarm(seconds, drive=lambda senses: (v, omega), places=(), charge=charge).run()


def energies(swarm: ScriptedSwarm) -> dict[str, EnergyReport]:
    return dict(swarm.core.report().energy)


def test_a_standing_robot_draws_its_idle_power() -> None:
    for one in energies(run_of(*STILL)).values():
        assert one.initial_j == pytest.approx(CAPACITY_J / 2) and one.charged_j == 0 and one.empty_s is None
        assert one.electronics_j == pytest.approx(ELECTRONICS * SECONDS)
        assert one.sensor_j == pytest.approx(SENSOR * SECONDS)
        assert one.radio_j == pytest.approx(RECEIVING * SECONDS)
        assert one.motors_j == 0
        assert one.charge == pytest.approx(0.5 - IDLE * SECONDS / CAPACITY_J)


def test_motors_draw_a_constant_force_up_to_the_first_measured_speed() -> None:
    swarm = run_of(0.3, 0.0)
    way = 0.3 * SECONDS - 0.3 * 0.3 / 2  # accelerates at 1 m/s²
    assert swarm.core.report().driven["r1"] == pytest.approx(way, rel=0.01)
    for one in energies(swarm).values():
        assert one.motors_j == pytest.approx(6.03 / 0.35 * way, rel=0.01)
        assert one.electronics_j == pytest.approx(ELECTRONICS * SECONDS)


def test_motors_draw_power_by_angle_while_turning() -> None:
    angle = SECONDS - 1 / (2 * 3.5)  # accelerates at 3.5 rad/s² to 1 rad/s
    for one in energies(run_of(0.0, 1.0)).values():
        assert one.motors_j == pytest.approx(17.6 / 1.5 * angle, rel=0.01)


def test_the_greater_motor_power_counts_and_is_constant_beyond_the_curve() -> None:
    battery = load_model("turtlebot2").battery
    assert battery is not None
    assert battery.motor_power(0.0, 0.0) == 0
    assert battery.motor_power(0.35, 0.0) == 6.03 and battery.motor_power(0.9, 0.0) == 14.0
    assert battery.motor_power(0.515, 0.0) == pytest.approx((6.03 + 14.0) / 2)
    assert battery.motor_power(0.35, 1.5) == battery.motor_power(0.0, 5.0) == 17.6


def test_transmitting_draws_the_difference_for_the_airtime_of_each_frame() -> None:
    talking = ScriptedSwarm(SECONDS, drive=lambda senses: STILL, talks=("r1",), places=(), charge=0.5).run()
    frames = talking.radio.counters_by_robot()["r1"]["frames_sent"]
    assert frames > 40
    airtime = frames * (6 + 9 + 20) * 32e-6  # header of the PHY, of the MAC, and 20 bytes of data
    found = energies(talking)
    assert found["r1"].radio_j == pytest.approx(
        RECEIVING * SECONDS + (TRANSMITTING - RECEIVING) * airtime, abs=3e-5
    )
    assert found["r2"].radio_j == pytest.approx(RECEIVING * SECONDS)


def test_robots_read_and_truth_records_the_charge_after_each_step() -> None:
    swarm = run_of(*STILL, seconds=1.0)
    read = [senses.battery for senses in swarm.acts["r1"].senses]
    assert read == pytest.approx([0.5 - IDLE * 0.1 * step / CAPACITY_J for step in range(11)])
    truths = [truth for truth in swarm.truths if not truth.halt]
    assert [truth.charges[0] for truth in truths] == read[:-1] and len(truths[0].charges) == 2


def test_an_empty_robot_is_switched_off_once_and_stops() -> None:
    swarm = ScriptedSwarm(
        4.0, drive=lambda senses: (0.4, 0.0), talks=("r1",), places=(), charge=20.0 / CAPACITY_J
    ).run()
    for robot, one in energies(swarm).items():
        assert one.charge == 0 and one.used_j == pytest.approx(20.0) and one.empty_s is not None
        assert IDLE * one.empty_s < 20.0 < (IDLE + 10.0) * one.empty_s
        senses = swarm.acts[robot].senses
        assert [said.halt for said in senses] == [False] * (len(senses) - 1) + [True]
        assert senses[-1].instant == round(one.empty_s * 1e6) and senses[-1].battery == 0
    states = [truth.robots[0] for truth in swarm.truths if not truth.halt]
    powered = [state.powered for state in states]
    off = powered.index(False)
    assert not any(powered[off:]) and not any(state.stepping for state in states[off:])
    assert len({(state.x, state.y) for state in states[off + 5 :]}) == 1
    charges = [truth.charges[0] for truth in swarm.truths if not truth.halt]
    assert all(charges[:off]) and not any(charges[off:])
    assert swarm.radio.counters()["frames_sent"] <= off and swarm.undelivered == 0


def test_a_restart_replaces_an_empty_battery_and_no_other() -> None:
    events = [(3.0, Restart("r1"))]
    empty = ScriptedSwarm(4.0, events, drive=lambda _: STILL, places=(), charge=20.0 / CAPACITY_J).run()
    one = energies(empty)["r1"]
    assert one.empty_s == pytest.approx(math.ceil(20.0 / IDLE * 10) / 10)
    assert one.charged_j == pytest.approx(CAPACITY_J) and one.used_j == pytest.approx(20.0 + IDLE)
    assert empty.acts["r1.1"].senses[0].battery == 1
    half = ScriptedSwarm(4.0, events, drive=lambda _: STILL, places=(), charge=0.5).run()
    assert energies(half)["r1"].charged_j == 0 and energies(half)["r1"].used_j == pytest.approx(4 * IDLE)


def test_being_carried_draws_nothing() -> None:
    moved = ScriptedSwarm(
        2.0, [(1.0, Move("r1", 14.0, 13.0, 0.0))], drive=lambda _: STILL, places=(), charge=0.5
    )
    assert energies(moved.run())["r1"].motors_j == 0


def batteries(charge: float | None) -> Batteries:
    return Batteries(ScriptedSwarm.setup_of(("r1", "r2"), charge=charge), [load_model("turtlebot2")] * 2)


def truth_of(robot: str, vx: float = 0.0, omega: float = 0.0, *, powered: bool = True) -> RobotTruth:
    return RobotTruth(robot, 0.0, 0.0, 0.0, vx, 0.0, omega, powered, powered, 0)


def test_energy_is_conserved_exactly() -> None:
    rng = np.random.default_rng(4)
    found = batteries(30.0 / CAPACITY_J)
    capacity = round(CAPACITY_J * 1e6)
    for step in range(2000):
        truths = [truth_of(name, *rng.uniform(-1, 1, 2), powered=rng.random() < 0.7) for name in ("r1", "r2")]
        found.begin(truths)
        if rng.random() < 0.4:
            found.charge(int(rng.integers(2)), float(rng.uniform(0, 60)))
        if rng.random() < 0.01:
            found.replace_empty(0)
        states = rng.uniform(-1, 1, (2, 6)).tolist()
        found.end(Instant((step + 1) * 100_000), states.__getitem__, rng.integers(0, 10**8, 2).tolist())
        for index in (0, 1):
            one = found.report(index)
            assert one is not None and found.charges[index] == one.charge
            initial, charged, *used = (
                round(energy * 1e6)
                for energy in (
                    *(one.initial_j, one.charged_j, one.electronics_j),
                    *(one.sensor_j, one.radio_j, one.motors_j),
                )
            )
            assert round(one.charge * capacity) == initial + charged - sum(used) >= 0
    assert found.report(0).charged_j > 500  # type: ignore[union-attr]


def test_a_charger_gives_at_most_the_charging_power_and_fills_at_most_the_battery() -> None:
    found = batteries(0.5)
    off = [truth_of(name, powered=False) for name in ("r1", "r2")]
    levels = []
    for power in (10.0, 100.0, 0.0, -5.0):
        found.begin(off)
        found.charge(0, power)
        assert found.end(Instant(100_000), lambda _: (0.0,) * 6, (0, 0)) == []
        levels.append(found.report(0).charged_j)  # type: ignore[union-attr]
    assert levels == pytest.approx([1.0, 4.0, 4.0, 4.0])
    assert found.charges[1] == 0.5
    full = batteries(1.0)
    full.begin(off)
    full.charge(0, 30.0)
    full.end(Instant(100_000), lambda _: (0.0,) * 6, (0, 0))
    assert full.charges == [1.0, 1.0] and full.report(0).charged_j == 0  # type: ignore[union-attr]


def test_a_radio_without_airtimes_is_an_error() -> None:
    found = batteries(0.5)
    with refused("the radio reports the airtimes of 0 robots; expected 2"):
        found.end(Instant(100_000), lambda _: (0.0,) * 6, ())


def test_without_batteries_nothing_is_sent_or_reported() -> None:
    swarm = run_of(*STILL, seconds=1.0, charge=None)
    assert swarm.core.report().energy == {} and not batteries(None).exist
    assert {truth.charges for truth in swarm.truths} == {()}
    assert {senses.battery for senses in swarm.acts["r1"].senses} == {None}


REST = Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        (SensorData(0, 0, 0, REST, 0), 8),
        (SensorData(0, 0, 0, REST, 0, items=([1.0, 2.0],)), 9),
        (SensorData(0, 0, 0, REST, 0, battery=0.5), 10),
        (Truth(0, 0, ()), 5),
        (Truth(0, 0, (), charges=(None, 0.25)), 7),
        (RadioAdvanced(0, ()), 2),
        (RadioAdvanced(0, (), (5,)), 3),
    ],
)
def test_trailing_defaults_are_omitted_one_by_one(message: Message, fields: int) -> None:
    payload = encode(message)
    assert len(msgspec.msgpack.decode(payload[1:])) == fields
    assert msgspec.msgpack.decode(payload[1:], type=type(message)) == message


@role
class Charged(Knowledge):
    charge: float | None = None


@component
class Thrifty(Charged):
    @periodic(every=seconds(0.1))
    def read(self, meter: BatteryMeter) -> "Thrifty":
        return replace(self, charge=meter.charge)


def test_a_component_reads_the_charge_by_its_port() -> None:
    start = Start("r1", 1, 0, Pose(1.0, 2.0, 0.0), (), np.random.default_rng(1))
    behaviour = host(start, Thrifty(id="r1"))
    for step, charge in enumerate((None, 0.75)):
        begin, end = Instant(step * 100_000), Instant((step + 1) * 100_000)
        behaviour.advance(View(begin, start.pose, False, None, (), battery=charge), end)
        node = node_of(behaviour)
        assert node is not None and node.knowledge("r1").charge == charge  # type: ignore[attr-defined]


def test_a_recorded_run_has_charges_in_its_model_pictures_result_and_metric(tmp_path: Path) -> None:
    text = HEAD_ON.read_text().replace("[robots]", "[robots]\nbattery = 0.5")
    result = record(tmp_path / "run", text, duration=3.0, detail="lean")
    run = read_run(tmp_path / "run")
    assert run.description.has_batteries and run.charge.shape == (30, 2)
    assert run.charge[0].tolist() == [0.5, 0.5] and (np.diff(run.charge, axis=0) < 0).all()
    radio = all_recordings(tmp_path / "run")["radio"]
    truths = [one for _, one in messages_on(radio, TRUTH) if not one.halt]
    for index, robot in enumerate(run.robots):
        energy = result.per_robot[robot].energy
        assert energy.used_j == pytest.approx((0.5 - energy.charge) * CAPACITY_J)
        states = [truth.robots[index] for truth in truths]
        driving = np.interp([math.hypot(one.vx, one.vy) for one in states], [0, 0.35, 0.68], [0, 6.03, 14])
        turning = np.interp([abs(one.omega) for one in states], [0, 1.5], [0, 17.6])
        used = np.trapezoid(np.maximum(driving, turning), dx=0.1) + 0.1 * IDLE * (len(states) - 1)
        assert used > 50 and (0.5 - run.charge[-1, index]) * CAPACITY_J == pytest.approx(used, rel=1e-4)
    assert result.energy_j == pytest.approx(
        sum(one.energy.used_j for one in result.per_robot.values()), abs=1e-3
    )
    poses = table_rows.tables(tmp_path / "run").rows["poses"]
    assert [row[-1] for row in poses] == run.charge.ravel().tolist()
    metric = task_metrics(result.declaration)["energy"]
    assert value_of(metric, result) == result.energy_j
    axes = run_page.draw(run).axes
    assert [one.get_ylabel() for one in axes].count("battery charge") == 1


def test_a_result_without_batteries_has_no_energy(short_run: Path) -> None:
    file = json.loads((short_run / "run.json").read_bytes())
    assert "energy_j" not in file and all("energy" not in one for one in file["per_robot"].values())
    run = read_run(short_run)
    assert np.isnan(run.charge).all() and run.result is not None
    assert math.isnan(value_of(task_metrics(run.result.declaration)["energy"], run.result) or 0.0)
    assert "battery charge" not in [one.get_ylabel() for one in run_page.draw(run).axes]


def test_a_charge_needs_a_battery_in_the_model() -> None:
    text = HEAD_ON.read_text().replace("[robots]", '[robots]\nbattery = 0.5\nmodel = "omnibox"')
    with refused(
        'robot r1: battery is 0.5, but the model "omnibox" has no table [battery]; add it, or remove the key'
    ):
        resolve(parse(text, HEAD_ON.parent / "of_a_test.toml"))


MODEL = """
name = "Bot"
mass = 5.0
friction = 0.2
odometry = "kobuki"
default_sensor = "lidar"
[footprint]
radius = 0.2
[drive]
kind = "differential"
speed = 0.5
acceleration = 1.0
turn_rate = 2.0
turn_acceleration = 3.0
[sensors.lidar]
field_of_view_deg = 360.0
rays = 90
range_max = 8.0
rate = 10.0
"""


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        (
            "[battery]\ncapacity_wh = 0.0",
            "battery.capacity_wh is 0.0, but must be a number above 0 and at most",
        ),
        (
            "[battery]\ncapacity_wh = 5.0\ndriving = [[0.0, 0.0], [0.0, 1.0]]",
            "have ascending points in driving",
        ),
        ("[battery]\ncapacity_wh = 5.0\ndriving = [[0.0, 0.0], [1.0, -1.0]]", "have points from [0, 0] to "),
        (
            "[battery]\ncapacity_wh = 5.0\nvoltage = [[0.0, 12.0], [0.9, 16.0]]",
            "have a voltage from the charge 0 to 1",
        ),
        (
            "[kobuki_errors]\nfeedback = 0.015",
            "kobuki_errors.feedback is 0.015, but must be a multiple of the",
        ),
        ("[stage_errors]\nforward = -0.1", "stage_errors.forward is -0.1, but must be "),
    ],
)
def test_faults_of_a_model_file_are_one_sentence(table: str, sentence: str, tmp_path: Path) -> None:
    file = tmp_path / "bot.toml"
    file.write_text(f"{MODEL}{table}\n")
    with pytest.raises(AcrcError, match=re.escape(sentence)) as caught:
        load_model(str(file))
    assert "\n" not in str(caught.value)


def test_a_model_file_sets_its_odometry_errors(tmp_path: Path) -> None:
    file = tmp_path / "bot.toml"
    file.write_text(f"{MODEL}[kobuki_errors]\nslip = 0.05\n[stage_errors]\nturn = 0.1\n")
    model, usual = load_model(str(file)), load_model("turtlebot2")
    assert model.kobuki_errors == msgspec.structs.replace(usual.kobuki_errors, slip=0.05)
    assert model.stage_errors == msgspec.structs.replace(usual.stage_errors, turn=0.1)
