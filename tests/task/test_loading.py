"""Which tasks may be loaded, and what is wrong with those that cannot."""

from pathlib import Path

import pytest

from actors.messages import Drive
from actors.runtime.errors import AcrcError
from actors.task.loading import DEFAULT, decode_reports, load_task, task_entry
from actors.task.task import TaskError
from actors.user_code import set_task_folders
from cleaning.task import CleaningTask
from deploy.scenario.resolve import resolve
from tests.in_process import acrc
from tests.refusals import refused
from tests.scenario.faults import MAP, scenario

TASK = """
from actors.task import Column, Judge, MarkStyle, Metric, Task, TaskDeclaration

def declared(*metrics, **fields):
    words = {"name": "idle", "table": "idle", "item": "item", "items": "items", "done": "done"}
    return TaskDeclaration(**words, metrics=metrics, **fields)

RANKED = Metric("waited", "time", "s", "waited_s", rank=1)

class Idle(Task):
    declaration = declared(RANKED)

class Undeclared(Task):
    pass

class Unranked(Task):
    declaration = declared(Metric("waited", "time", "s", "waited_s"))

class Twice(Task):
    declaration = declared(RANKED, RANKED)

class Unsendable(Task):
    declaration = declared(RANKED)
    item = complex

class Unmarked(Task):
    declaration = declared(RANKED, marks={"open": MarkStyle("heart", "an item")})

class Colourless(Task):
    declaration = declared(RANKED, causes={"resting": ("grey", "")})

class Broken(Task):
    declaration = declared(RANKED)
    def __init__(self):
        raise ValueError("not today")

class NoTask:
    pass

class Undrawn(Idle):
    def draw(self, settings, placing):
        return [][1]

class Empty(Idle):
    def draw(self, settings, placing):
        return None

class Misdrawn(Idle):
    def draw(self, settings, placing):
        return ("far",)

class Unchecked(Idle):
    def check(self, item, grid):
        raise OSError("full")

class Unset(Idle):
    def settings_fault(self, settings, robots, listed, areas):
        return robots[99]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "idle_task.py").write_text(TASK)
    set_task_folders((folder,))
    return folder


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("idle_task:Undeclared",
         "declares None; must have a TaskDeclaration as attribute `declaration`"),
        ("idle_task:Unranked",
         "declares no metric with a rank; must have at least one, by which runs are compared"),
        ("idle_task:Twice", "declares the metrics waited, waited; their names must be unique"),
        ("idle_task:Unmarked", "declares 'open' with the symbol 'heart'; must be one of "),
        ("idle_task:Colourless", "declares the cause 'resting' as ('grey', ''); must have a colour such as "),
        ("idle_task:NoTask", "is <class 'idle_task.NoTask'>; must be a subclass of actors.task.Task"),
        ("idle_task:Broken", "cannot be created: ValueError: not today (idle_task.py:"),
        ("idle_task:Nothing", "module 'idle_task' has no 'Nothing'; did you mean Task?"),
        ("idle_task.py", ", or give module:Class of your own, such as idle_task:Task"),
        ("no_such_task:Task", "its module is not installed; name its folder with --modules DIR"),
        ("../idle_task:Task", "its module is not installed; name its folder with --modules DIR"),
        (":Task", "its module is not installed; name its folder with --modules DIR"),
    ],
)  # fmt: skip
def test_a_faulty_task_gives_one_sentence(folder: Path, name: str, sentence: str) -> None:
    with pytest.raises(TaskError) as caught:
        load_task(name)
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("Undrawn", "", "task idle, draw failed: IndexError: list index out of range (idle_task.py:"),
        ("Empty", "", "task idle, draw failed: TypeError: 'NoneType' object is not iterable (loading.py:"),
        ("Misdrawn", "", "idle drawn for r1[0] is \"far\", but must be a point [x, y] in m"),
        ("Unchecked", "[[robot]]\nid = 'r1'\nidle = [[12, 12]]",
         "task idle, check failed: OSError: full (idle_task.py:"),
        ("Unset", "", "task idle, settings_fault failed: IndexError: tuple index out of range ("),
    ],
)  # fmt: skip
def test_a_fault_of_a_method_gives_one_sentence(folder: Path, name: str, text: str, sentence: str) -> None:
    head = f'task.use = "idle_task:{name}"\nrun = {{ strategy = "none" }}\n'
    with pytest.raises(AcrcError) as caught:
        resolve(scenario(text, head=MAP + head))
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("instant", [-1, 999, 2000])
def test_a_report_has_an_instant_of_its_step(instant: int) -> None:
    answer = Drive(0, 0.0, 0.0, 0.0, 0, reports=(["r1", 0, instant],))
    with refused(f"sends a task report at {instant} µs; must be from 1000 to 1999 µs"):
        decode_reports(CleaningTask(), answer, 1000, 2000)
    assert decode_reports(CleaningTask(), answer, instant, instant + 1).reports[0].instant == instant


def test_items_must_be_sendable(folder: Path) -> None:
    with pytest.raises(TaskError, match="declares an item or report that cannot be sent: "):
        load_task("idle_task:Unsendable")


def test_names_and_entries(folder: Path) -> None:
    assert task_entry(DEFAULT) == "cleaning.task:CleaningTask" and isinstance(
        load_task(DEFAULT), CleaningTask
    )
    assert load_task("idle_task:Idle").declaration.name == "idle"


def test_a_task_must_be_installed_or_in_a_named_folder(folder: Path) -> None:
    set_task_folders(())
    sentence = "its module is not installed; name its folder with --modules DIR"
    with refused(f"task 'idle_task:Idle': {sentence}"):
        load_task("idle_task:Idle")
    with refused(f"task 'tests.task.parcels:Parcels': {sentence}"):
        load_task("tests.task.parcels:Parcels")


def test_a_file_does_not_permit_a_task_even_if_it_is_trusted(tmp_path: Path) -> None:
    """A scenario names a folder of modules, and the task beside it; a strategy there may be trusted."""
    (tmp_path / "beside_task.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n{TASK}")
    file = tmp_path / "some.toml"
    maps = Path(__file__).parents[2] / "maps"
    file.write_text(
        f'map = "{maps}/corridor.yaml"\ntask.use = "beside_task:Idle"\n'
        'run = {strategy = "none", modules = ".", duration = 1.0}\n'
    )
    for options in ((), ("--trust",)):
        done = acrc("run", file, *options, "--bus", "memory", "--out", tmp_path / "out", cwd=tmp_path)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr == (
            f"acrc: {file}: task 'beside_task:Idle': its module is not installed; "
            "name its folder with --modules DIR\n"
        )
    assert not (tmp_path / "ran").exists()
