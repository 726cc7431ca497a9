"""Loading a behaviour by its entry string, and every way in which that goes wrong."""

from pathlib import Path

import pytest

from actors.geometry import Point, Pose
from actors.randomness import generator
from actors.robot.behaviour.entry import BehaviourError, load_behaviour
from actors.robot.behaviour.ports import Start
from tests.robot.behaviours import Scripted

START = Start("r1", 1, 0, Pose(0.0, 0.0, 0.0), (Point(1.0, 2.0),), generator(1, "behaviour", "r1"))


def test_the_function_is_called_with_the_start() -> None:
    behaviour = load_behaviour("tests.robot.behaviours:keeper", START)
    assert isinstance(behaviour, Scripted)
    assert behaviour.decision is not None


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("cleaning.strategies.none", "is no entry; it should look like 'package.module:function'"),
        (":behaviour", "is no entry; it should look like 'package.module:function'"),
        ("cleaning.strategies.none:", "is no entry; it should look like 'package.module:function'"),
        (".baseline:behaviour", "is no entry; it should look like 'package.module:function'"),
    ],
)
def test_text_that_is_no_entry(entry: str, sentence: str) -> None:
    with pytest.raises(BehaviourError) as caught:
        load_behaviour(entry, START)
    assert str(caught.value) == f"behaviour {entry!r} {sentence}"


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        (
            "nowhere.study:behaviour",
            "behaviour 'nowhere.study:behaviour': there is no module 'nowhere' on Python's path",
        ),
        (
            "tests.none:behaviour",
            "behaviour 'tests.none:behaviour': there is no module 'tests.none' on Python's path",
        ),
        (
            "tests.robot.behaviours:other",
            "behaviour 'tests.robot.behaviours:other': module 'tests.robot.behaviours' has no 'other'",
        ),
        (
            "tests.robot.behaviours:number",
            "behaviour 'tests.robot.behaviours:number' is a int, but should be a function of a Start",
        ),
        (
            "tests.robot.behaviours:nothing",
            "behaviour 'tests.robot.behaviours:nothing' gives a NoneType, "
            "which has no method advance(view, until)",
        ),
    ],
)
def test_an_entry_that_leads_to_no_behaviour(entry: str, sentence: str) -> None:
    with pytest.raises(BehaviourError) as caught:
        load_behaviour(entry, START)
    assert str(caught.value) == sentence


def test_errors_of_the_users_own_code_are_passed_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ZeroDivisionError):
        load_behaviour("tests.robot.behaviours:fails", START)
    (tmp_path / "study_without_library.py").write_text("import no_such_library\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BehaviourError) as refused:
        load_behaviour("study_without_library:behaviour", START)
    assert str(refused.value) == (
        "behaviour 'study_without_library:behaviour': study_without_library imports 'no_such_library', which "
        "is not installed; `acrc add NAME` installs a package for good, by the name that pip knows it by"
    )
    (tmp_path / "study_of_a_part.py").write_text("import json.no_such_part\n")
    with pytest.raises(ModuleNotFoundError) as caught:
        load_behaviour("study_of_a_part:behaviour", START)
    assert caught.value.name == "json.no_such_part"


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("def behaviour(start):\n    return 1 +\n", "{file}:2: invalid syntax: return 1 +"),
        ("import sys\nsys.exit('no')\n", "its code called sys.exit('no') ({file.name}:2)"),
        ("def behaviour(start):\n    exit(3)\n", "its code called sys.exit(3) ({file.name}:2)"),
    ],
)
def test_code_that_is_no_python_or_ends_its_process_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, fault: str
) -> None:
    file = tmp_path / f"study_{abs(hash(text))}.py"
    file.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BehaviourError) as caught:
        load_behaviour(f"{file.stem}:behaviour", START)
    assert str(caught.value) == f"behaviour '{file.stem}:behaviour': {fault.format(file=file)}"
