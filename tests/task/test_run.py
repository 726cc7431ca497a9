"""A task that is not cleaning, from the scenario to the result, in memory."""

import csv
import json
import sys
from pathlib import Path

import pytest

from acrc_testbed.recordings.record_replay import recheck
from acrc_testbed.run_model.simulated_runs import read_run
from actors.runtime.errors import AcrcError
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, parse
from deploy.scenario.tables import Scenario, to_toml
from tests.in_process import acrc
from tests.recorded_runs import record
from tests.refusals import refused
from tests.scenario.faults import FILE, MAP, fault, scenario
from tests.task.parcels import ParcelsTable

HEAD = """
task.use = "tests.task.parcels:Parcels"
run = { strategy = "tests.task.parcels:carrier", duration = 60.0 }
localisation.preset = "odometry"
"""
SCENARIO = (
    f'map = "../maps/corridor.yaml"\n{HEAD}'
    """
[robots]
count = 2
odometry = "exact"
[[robot]]
id = "r1"
start = [12.0, 12.5, 0.0]
parcels = [{x = 12.8, y = 12.5, kilograms = 3.5}]
[[robot]]
id = "r2"
start = [20.0, 12.0, 0.0]
parcels = []
[[event]]
at = 2.0
give = "r2"
parcels = [{x = 20.6, y = 12.0}]
"""
)


def test_a_run_of_another_task(tmp_path: Path) -> None:
    out = tmp_path / "run"
    result = record(out, SCENARIO)
    assert result.declaration.name == "parcels" and {*result.declaration.schemas} == {"item", "report"}
    last = result.task["last_s"]
    assert result.task["kilograms"] == 4.5 and isinstance(last, float) and 2.0 < last < 60.0
    assert (result.task_summary, result.task_notes) == ("delivered 4.5 kg", ())
    assert {robot: one.task for robot, one in result.per_robot.items()} == {
        "r1": {"kilograms": 3.5},
        "r2": {"kilograms": 1.0},
    }
    with (out / "parcels.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["parcel"] for row in rows] == ["r1/0", "r2/0"] and float(rows[1]["delivered_s"]) > 2.0
    assert json.loads((out / "run.json").read_text())["task"] == result.task
    assert recheck(out).actors == 4
    run = read_run(out)
    assert next((str(one.key), one.state) for _, one in run.marks) == ("r1/0", "waiting")
    assert {one.kind for one in run.task_events} == {"waiting for a dock", "delivered", ""}
    copied = parse((out / "scenario.toml").read_text(), out / "scenario.toml")
    assert copied.robot[0].items == ({"x": 12.8, "y": 12.5, "kilograms": 3.5},)
    assert record(tmp_path / "again", copied).digest == result.digest


def test_a_result_is_printed_in_the_words_of_the_task(tmp_path: Path) -> None:
    file = tmp_path / "parcels.toml"
    file.write_text(SCENARIO.replace("../maps", str(Path(__file__).parents[2] / "maps")))
    done = acrc("run", file, "--bus", "memory", "--modules", ".", "--out", tmp_path / "run", "--duration", 9)
    assert done.returncode == 0, done.stderr
    assert "delivered, kg" in done.stdout and "delivered 4.5 kg." in done.stdout
    assert "place" not in done.stdout.replace("in place", "")


def of_parcels(text: str, head: str = HEAD) -> Scenario:
    return scenario(text, head=MAP + head)


def test_tables_and_items_of_the_task() -> None:
    read = of_parcels("[parcels]\nper_robot = 2\n[[robot]]\nid = 'r2'\nparcels = [{x = 12, y = 12.5}]")
    assert read.task_settings == {"per_robot": 2} and read.robot[0].items == ({"x": 12, "y": 12.5},)
    resolved = resolve(read)
    first, second, *_ = resolved.world.robots
    assert (len(first.items), second.items) == (2, ({"x": 12.0, "y": 12.5, "kilograms": 1.0},))
    assert resolved.world.task.use == "tests.task.parcels:Parcels"
    written = to_toml(resolved.scenario)
    assert "parcels = " in written and "task_settings" not in written and "places" not in written
    again = resolve(parse(written, FILE))
    assert again.world == resolved.world and to_toml(again.scenario) == written
    assert of_parcels("[parcels]").task_settings == {} and ParcelsTable().per_robot == 1


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[parcels]\nper_robot = 10", "parcels.per_robot is 10, but must be a whole number from 0 to 9"),
        ("[parcels]\nperrobot = 1", "unknown key parcels.perrobot; did you mean parcels.per_robot?"),
        ("[places]\nper_robot = 1", "unknown key places; did you mean planner?"),
        ("[[robot]]\nid = 'r1'\nplaces = [[1, 2]]", "unknown key robot[0].places; known keys of robot[0]: "
         "id, model, sensor, odometry, battery, start, parcels, adversary"),
        ("[[robot]]\nid = 'r1'\nparcels = 3",
         "robot[0].parcels is 3, but must be a list of at most 1000 items of the task"),
        ("[[robot]]\nid = 'r1'\nparcels = [{x = 1, y = 2}, [1, 2]]",
         "robot[0].parcels[1] is [1, 2]: Expected `object`, got `array`"),
        ("[[robot]]\nid = 'r1'\nparcels = [{x = 1, y = 2, kilograms = 99}]",
         'robot[0].parcels[0] is {"x": 1, "y": 2, "kilograms": 99}: Expected `float` <= 50.0 - at '
         "`$.kilograms`"),
        ("[[event]]\nat = 1\ngive = 'r1'\nparcels = [{x = 1}]",
         'event[0].parcels[0] is {"x": 1}: Object missing required field `y`'),
        ("[[event]]\nat = 1\ngive = 'r1'", "event[0].parcels is missing; give requires parcels"),
        ("[[event]]\nat = 1\nkill = 'r1'\nparcels = [{x = 1, y = 1}]",
         "event[0].parcels cannot be used with kill, which takes no other key"),
        ("[task_settings]\nper_robot = 1", "task_settings is not a key; the task's key is parcels"),
    ],
)  # fmt: skip
def test_errors_name_the_key_of_the_file(text: str, sentence: str) -> None:
    assert fault(text, head=MAP + HEAD) == f"some.toml: {sentence}"


def test_an_item_at_a_wall() -> None:
    with pytest.raises(AcrcError) as caught:
        resolve(of_parcels("[[robot]]\nid = 'r2'\nparcels = [{x = 5, y = 12.5}]"))
    assert str(caught.value).startswith('parcel 0 of robot r2 is {"x": 5, "y": 12.5}, but must be on free')


def test_a_task_without_a_baseline_requires_a_strategy() -> None:
    head = HEAD.replace('strategy = "tests.task.parcels:carrier", ', "")
    assert fault("", head=MAP + head) == (
        "some.toml: run.strategy is missing, but must be a strategy for the task parcels"
    )
    assert fault("", Overrides(strategy="none"), head=MAP + head) == "nothing was wrong"


@pytest.mark.parametrize(
    ("report", "sentence"),
    [
        ("Delivered((7,))", "r1 reports parcel 7, which it was not given"),
        ("VisitReport('r1', 0, view.instant)", "r1 reports (['r1', 0, 100000],): "),
        ("Delivered(tuple(range(2000)))", "r1 sends a task report of"),
        ("(1, 2)", "r1 reports (1, 2); must be a struct of the task, a subclass of MessagePart"),
    ],
)
def test_wrong_reports_end_the_run(
    report: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "reporting_of_test.py").write_text(
        "from actors.robot.behaviour import Decision\n"
        "from cleaning.place import VisitReport\n"
        "from tests.task.parcels import Delivered\n"
        "class Reporter:\n"
        "    def advance(self, view, until):\n"
        f"        return Decision(reports=({report},) if view.instant else ())\n"
        "def behaviour(start):\n"
        "    return Reporter()\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "reporting_of_test", raising=False)
    with pytest.raises(AcrcError) as caught:
        record(tmp_path / "run", SCENARIO, strategy="reporting_of_test:behaviour")
    assert sentence in str(caught.value) and "\n" not in str(caught.value)
    assert str(caught.value).startswith("step 1 (0.1 s): ")


def test_cleaning_refuses_internal_keys() -> None:
    with refused("some.toml: task_settings is not a key; the task's key is places"):
        parse(f"{MAP}[task_settings]\nper_robot = 1", FILE)
