"""What is compiled before the first run is said, and how far it is; afterwards nothing is said."""

from pathlib import Path

import pytest

from actors.processes import kernels
from actors.runtime.recording import scans
from actors.task import visits


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with nothing in it, as far as can be told, and one module to compile."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernels, "kernel_modules", lambda onboard=False: (visits,))
    return tmp_path


def test_the_first_time_is_announced_and_the_second_time_is_silent(
    cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kernels.compile_kernels()
    said = capsys.readouterr().err.splitlines()
    assert said[0] == (
        "acrc: compiling the numeric kernels, once after an installation or a change of the sources: "
        "1 modules"
    )
    assert said[1].startswith("acrc: compiled in ") and len(said) == 2
    kernels.compile_kernels()
    assert capsys.readouterr().err == ""
    (cache / "complete").write_text("another processor\n")
    kernels.compile_kernels()
    assert "compiling" in capsys.readouterr().err


@pytest.mark.nightly
def test_a_person_at_a_terminal_sees_how_far_it_is(
    cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    kernels.compile_kernels()
    assert "1/1" in capsys.readouterr().err


def test_a_program_that_wants_json_is_told_nothing(cache: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kernels.compile_kernels(quiet=True)
    assert capsys.readouterr() == ("", "")
    assert (cache / "complete").is_file()


@pytest.mark.parametrize("helper", ["raise SystemExit"])
def test_what_helpers_cannot_compile_is_compiled_all_the_same(
    helper: str, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They die at once, say something else, or read nothing."""
    asked: list[str] = []
    monkeypatch.setattr(kernels, "_HELPER", helper)
    monkeypatch.setattr(kernels, "kernel_modules", lambda onboard=False: (visits, scans))
    monkeypatch.setattr(kernels, "fingerprints", lambda modules: asked.extend(m.__name__ for m in modules))
    kernels.compile_kernels(quiet=True)
    assert sorted(asked) == sorted([visits.__name__, scans.__name__])
    assert (cache / "complete").is_file()


def test_every_module_with_kernels_is_compiled_once() -> None:
    names = [module.__name__ for module in kernels.kernel_modules()]
    robot = "actors.robot.local_planning.dwa"
    assert {"actors.world.rays", "actors.radio.medium.medium", robot} <= set(names)
    assert len(names) == len(set(names)) > 20


def test_a_robot_s_computer_compiles_what_a_robot_needs_and_nothing_of_the_world() -> None:
    robot, everything = (
        {module.__name__ for module in kernels.kernel_modules(onboard=onboard)} for onboard in (True, False)
    )
    assert robot < everything
    assert "actors.robot.local_planning.dwa" in robot and not any(
        name.startswith("actors.world") for name in robot
    )


@pytest.mark.nightly
def test_what_a_robot_compiles_does_not_count_for_a_run(
    cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kernels.compile_kernels(onboard=True)
    kernels.compile_kernels(onboard=True)
    assert capsys.readouterr().err.count("compiling") == 1
    kernels.compile_kernels()
    assert capsys.readouterr().err.count("compiling") == 1
    (cache / "complete").write_text("".join((cache / "complete").read_text().splitlines(True)[1:]))
    kernels.compile_kernels(onboard=True)
    assert capsys.readouterr().err == "", "what a run computes with holds what a robot does"
