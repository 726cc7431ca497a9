from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from deploy.run.options import RunOptions, checked


def test_what_is_not_said_has_a_default(tmp_path: Path) -> None:
    assert checked(RunOptions(tmp_path)) == RunOptions(
        tmp_path, speed="max", bus="zenoh", spawn="forkserver", isolate=None, view=False, json=False
    )


def test_the_folder_becomes_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert checked(RunOptions(Path("runs/a"))).out == tmp_path / "runs/a"


@pytest.mark.parametrize("speed", ["max", "1", "0.5", "4e2"])
def test_speeds_that_are_right(tmp_path: Path, speed: str) -> None:
    assert checked(RunOptions(tmp_path, speed=speed)).speed == speed


@pytest.mark.parametrize("speed", ["fast", "0", "0.009", "-1", "nan", "inf", "", "1x"])
def test_speeds_that_are_wrong(tmp_path: Path, speed: str) -> None:
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path, speed=speed))
    shown = speed or "''"
    assert str(caught.value) == f'--speed: {shown}; must be "max" or a number from 0.01 on, such as 1 or 4'


def test_choices_that_are_wrong(tmp_path: Path) -> None:
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path, bus="ether"))
    assert str(caught.value) == "--bus: ether; must be zenoh or memory"
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path, spawn="fork"))
    assert str(caught.value) == "--spawn: fork; must be forkserver or exec"


def test_options_that_do_not_go_together(tmp_path: Path) -> None:
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path, bus="memory", isolate=True))
    assert str(caught.value) == (
        "--isolate: --bus memory has one process for all robots; must stand with --bus zenoh"
    )
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path, bus="memory", view=True))
    assert str(caught.value) == (
        "--view: --bus memory is one process, and starts none that looks on; must stand with --bus zenoh"
    )
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path, followed=("r2",)))
    assert str(caught.value) == "--robot: 'r2'; must stand with --view"
    assert checked(RunOptions(tmp_path, bus="memory", isolate=False)).isolate is False


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OptionError) as caught:
        checked(RunOptions(tmp_path / "file"))
    assert str(caught.value) == f"--out: {tmp_path}/file is a file; must be a folder that is new or empty"
