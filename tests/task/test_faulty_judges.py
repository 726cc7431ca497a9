"""A judge that raises, answers wrongly, never finishes, or uses chance: one sentence each, in memory."""

import re
import sys
from pathlib import Path

import pytest

from acrc_testbed.recordings.record_replay import RecheckError, recheck
from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from actors.task.loading import load_task
from actors.user_code import set_task_folders
from tests.in_process import acrc
from tests.recorded_runs import record
from tests.task.test_run import SCENARIO

JUDGE = """
import random
import numpy as np
from actors.task import ItemKey, TaskOutcome, TaskProgress
from tests.task.parcels import ParcelJudge, Parcels

class Faulty(ParcelJudge):
{method}

class Tasks(Parcels):
    def judge(self, setup):
        return Faulty(setup)
"""
WATCH = "def watch(self, instant, positions):\n        if instant == 300_000: "
TAKE = "def take(self, robot, answer, begin, end):\n        "
SETTLED = "settled = property(lambda self: "
OUTCOME = "def outcome(self, present, end):\n        found = super().outcome(present, end)\n        "
GIVE = "def give(self, instant, robot, items): "
OF_OUTCOME = "return TaskOutcome(found.summary, {values}, found.robots, found.items)"
FAULTS = {
    f"{WATCH}raise ValueError('lost')": "watch at 0.3 s failed: ValueError: lost (LINE)",
    f"{WATCH}self.nothing": "watch at 0.3 s failed: AttributeError: 'Faulty' object has no ",
    f"{WATCH}raise SystemExit(3)": "watch at 0.3 s failed: its code called sys.exit(3) (LINE)",
    f"{WATCH}self.mark(ItemKey('r1', 0), (1.0, 2.0), 'gone')":
        " y=2.0, state='gone', by=''); must be in a state of ['waiting']",
    f"{WATCH}self.mark(ItemKey('r1', 0), (np.float64(1.0), 2e9), 'waiting')": "mark at 0.3 s got ItemMark(",
    f"{WATCH}self.note('r1', 0, 'lost')":
        " number=0, text=''); must be of a kind of ['delivered', 'waiting for a dock']",
    f"{WATCH}self.note('r7', 0, 'delivered')": "note at 0.3 s got TaskEvent(robot='r7', ",
    f"{TAKE}return 1 / 0 if answer.reports else None": " s failed: ZeroDivisionError: division by",
    f"{TAKE}return bool(answer.reports) or None": "returned True; must be None or a sentence",
    f"{SETTLED}1)": "settled at 0 s is 1; must be True or False",
    f"{SETTLED}self.missing)": "settled at 0 s failed: AttributeError: 'Faulty' object ",
    "def progress(self, present):\n        return 1, 2":
        "progress at 1 s returned (1, 2); must be a TaskProgress of whole numbers",
    "def progress(self, present):\n        return TaskProgress(np.int64(1), 2)": "at 1 s returned TaskP",
    f"{OUTCOME}raise KeyError('kilograms')": "failed: KeyError: 'kilograms' (LINE)",
    f"{OUTCOME}return dict(found.values)": "returned {'kilograms': 0, 'last_s': None}; must be a TaskOutcome",
    f"{OUTCOME}{OF_OUTCOME.format(values='{}')}":
        "has no value in column 'kilograms' of a metric; must be a number or None",
    f"{OUTCOME}{OF_OUTCOME.format(values='dict(found.values, kilograms=chr(65))')}":
        "has the value 'A' in column 'kilograms' of a metric; must be a number or None",
    f"{OUTCOME}{OF_OUTCOME.format(values='dict(found.values, kilograms=np.nan)')}":
        "has 'kilograms' = nan; must be a finite number, text, boolean or None",
    f"{GIVE}raise RuntimeError('full')": "give at 2 s failed: RuntimeError: full (LINE)",
    f"{GIVE}return 3": "give at 2 s returned 3; must be None or a sentence",
    "def __init__(self, setup):\n        raise OSError('no')": "judge at 0 s failed: OSError: no (LINE)",
}  # fmt: skip


def write(folder: Path, method: str, name: str = "faulty_judge") -> str:
    """Write the module of a task; return its scenario."""
    set_task_folders((folder, REPOSITORY))
    load_task.cache_clear()
    sys.modules.pop(name, None)
    (folder / f"{name}.py").write_text(JUDGE.format(method=f"    {method}"))
    return SCENARIO.replace("tests.task.parcels:Parcels", f"{name}:Tasks").replace("60.0", "3.0")


@pytest.mark.parametrize("method", FAULTS)
def test_a_faulty_judge_ends_the_run_with_one_sentence(method: str, tmp_path: Path) -> None:
    with pytest.raises(AcrcError) as caught:
        record(tmp_path / "run", write(tmp_path, method))
    found = re.sub(r"faulty_judge\.py:\d+", "LINE", str(caught.value))
    assert FAULTS[method] in found and found.count("task parcels, ") == 1 and "\n" not in found


def test_an_event_that_the_task_refuses_is_no_fault_of_its_judge(tmp_path: Path) -> None:
    text = write(tmp_path, f"{GIVE}return 'is full'")
    with pytest.raises(AcrcError, match=r"^event at 2 s failed: is full$"):
        record(tmp_path / "run", text)


def test_a_judge_that_never_finishes_ends_with_the_duration(tmp_path: Path) -> None:
    result = record(tmp_path / "run", write(tmp_path, f"{SETTLED}False)"))
    assert result.simulated_s == 3.0 and result.task_notes == ("Some parcels are left.",)


def test_an_endless_loop_is_named_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "loop.toml"
    text = write(tmp_path, f"{WATCH}\n            while True: pass")
    file.write_text(text.replace("../maps", str(REPOSITORY / "maps")))
    words = ("--bus", "memory", "--timeout", 1, "--modules", tmp_path, "--modules", ".")
    done = acrc("run", file, *words, "--out", tmp_path / "run")
    assert done.returncode == 1
    assert re.search(r"world has not finished the step .* at faulty_judge\.py:\d+ \(watch\)", done.stderr)


@pytest.mark.parametrize("chance", ["random.random()", "id(self) % 1000 / 1000"])
def test_a_judge_that_uses_chance_fails_the_check_of_the_run(tmp_path: Path, chance: str) -> None:
    method = f"def outcome(self, present, end): return super().outcome(present, end)\n    {WATCH}"
    text = write(tmp_path, f"{method}self.mark(ItemKey('r1', 0), (12.0 + {chance}, 12.5), 'waiting')")
    record(tmp_path / "run", text)
    with pytest.raises(RecheckError, match=r"^world: the replay differs, so the code"):
        recheck(tmp_path / "run")
