"""Start of a run: kernels and shared data are made once; progress without a terminal."""

import io
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console

from acrc_testbed.command_line import campaign_commands
from acrc_testbed.experiments.campaign import CampaignProgress
from actors.floor import raster
from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY
from actors.kernels import load_numba
from actors.messages import Progress
from actors.processes import kernel_compilation
from actors.processes.launcher import Program, create_launcher
from actors.processes.monitor import Timeout
from actors.robot import assembly
from actors.robot.stack import Stack
from actors.runtime.process_table import python_command
from actors.runtime.recording import scans
from cleaning import visits
from cleaning.task import CleaningTask
from deploy.run import progress
from deploy.run.options import RunOptions
from deploy.run.plan import shared_arguments
from deploy.run.swarm import plan, run_in_memory
from deploy.scenario.scenario_file import Overrides, load_scenario

MAPS = Path(__file__).parents[2] / "maps"
CHAPTER = MAPS.parent / "scenarios" / "chapter.toml"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernel_compilation, "kernel_modules", lambda onboard=False: (visits,))
    monkeypatch.setattr(load_numba(), "unpack_kernels", set)
    return tmp_path


def test_compiling_is_announced_until_the_cache_is_complete(
    cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_compilation, "_COMPILER", ("-c", "raise SystemExit"))
    monkeypatch.setattr(kernel_compilation, "fingerprints", lambda modules: None)
    kernel_compilation.compile_kernels()
    first, second = capsys.readouterr().err.splitlines()
    assert first == (
        "acrc: compiling numeric kernels (once after an installation or a source change): 1 modules"
    )
    assert second.startswith("acrc: compiled in ")
    kernel_compilation.compile_kernels()
    assert capsys.readouterr().err == ""
    (cache / "complete").write_text("another processor\n")
    kernel_compilation.compile_kernels(quiet=True)
    assert capsys.readouterr() == ("", "") and (cache / "complete").is_file()


@pytest.mark.nightly
def test_a_terminal_shows_the_progress_of_compiling(
    cache: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    kernel_compilation.compile_kernels()
    assert "1/1" in capsys.readouterr().err


def test_modules_that_helpers_fail_to_compile_are_compiled(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(kernel_compilation, "_COMPILER", ("-c", "raise SystemExit"))
    monkeypatch.setattr(kernel_compilation, "kernel_modules", lambda onboard=False: (visits, scans))
    monkeypatch.setattr(
        kernel_compilation, "fingerprints", lambda modules: asked.extend(m.__name__ for m in modules)
    )
    kernel_compilation.compile_kernels(quiet=True)
    assert sorted(asked) == sorted([visits.__name__, scans.__name__])
    assert (cache / "complete").is_file()


@pytest.mark.nightly
def test_kernels_of_the_compiler_are_those_of_any_other_process(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [*python_command(), *kernel_compilation._COMPILER]
    module = f"{scans.__name__}\n"
    for _ in range(2):  # compiled, then loaded
        done = subprocess.run(
            command, input=module, env=environment, capture_output=True, text=True, check=True
        )
        assert done.stdout == module
    for whole in tmp_path.rglob("*.whole.*"):
        whole.unlink()  # compiled again from the compiler's kernels for kernels
    program = f"from {scans.__name__} import fingerprint; print(fingerprint().hex())"
    for _ in range(2):  # compiled, then loaded
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        assert bytes.fromhex(done.stdout) == scans.fingerprint()


def test_a_run_compiles_every_module_once_and_a_robots_computer_nothing_of_the_world() -> None:
    robot, names = (
        [module.__name__ for module in kernel_compilation.kernel_modules(onboard=onboard)]
        for onboard in (True, False)
    )
    planner = "actors.robot.navigation.dwa"
    assert {"actors.world.rays", "actors.radio.medium.medium", planner} <= set(names)
    assert len(names) == len(set(names)) > 20
    assert set(robot) < set(names) and planner in robot
    assert not any(name.startswith("actors.world") for name in robot)


@pytest.mark.nightly
def test_compilation_by_a_robot_does_not_count_for_a_run(
    cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kernel_compilation.compile_kernels(onboard=True)
    kernel_compilation.compile_kernels(onboard=True)
    assert capsys.readouterr().err.count("compiling") == 1
    kernel_compilation.compile_kernels()
    assert capsys.readouterr().err.count("compiling") == 1
    (cache / "complete").write_text("".join((cache / "complete").read_text().splitlines(True)[1:]))
    kernel_compilation.compile_kernels(onboard=True)
    assert capsys.readouterr().err == "", "what a run computes with holds what a robot does"


def test_a_log_has_a_line_of_progress_every_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("deploy.run.progress.time.monotonic", lambda: now[0])
    for quiet, lines in (
        (
            False,
            ["acrc: 40 of 600 s simulated, 10 of 40 places", "acrc: 80 of 600 s simulated, 20 of 40 places"],
        ),
        (True, []),
    ):
        with progress.show_progress(600_000_000, 40, CleaningTask.declaration, quiet=quiet) as follow:
            for second in range(25):
                now[0] = float(second)
                follow(Progress(second, second * 4_000_000, 40 - second, second, finished=False))
        assert capsys.readouterr().err.splitlines() == ([] if quiet else lines)
    written = io.StringIO()
    monkeypatch.setattr(progress, "LINE_INTERVAL_S", -1.0)
    progress.line_printer(Console(file=written, width=20))("word " * 30)
    assert written.getvalue().count("\n") == 1


def test_a_campaign_reports_the_progress_of_its_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("deploy.run.progress.time.monotonic", lambda: now[0])
    for quiet in (False, True):
        with campaign_commands.progress_display(quiet=quiet) as follow:
            for second in range(35):
                now[0] = float(second)
                left_s = None if second < 15 else 400.0 - second
                follow(CampaignProgress(min(second, 20), second // 8, 20, left_s))
    assert capsys.readouterr().err.splitlines() == [
        "acrc: 10 of 20 runs, 1 failed",
        "acrc: 20 of 20 runs, 2 failed, repeating some to check them, about 6 min left",
        "acrc: 20 of 20 runs, 3 failed, repeating some to check them, about 6 min left",
    ]


def test_a_forked_process_has_the_shared_data_of_its_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(REPOSITORY))  # of the package `tests`
    shutil.copytree(MAPS, tmp_path / "maps")
    stack = msgspec.json.encode(Stack()).decode()
    log = tmp_path / "heir.log"
    with create_launcher("forkserver") as launched:
        for name in ("none.yaml", "maps/corridor.yaml"):  # the first is left to who needs it
            launched.share("actors.robot.program", (name, "turtlebot2", "", stack), tmp_path)
        argv = (str(tmp_path / "maps" / "corridor.yaml"), str(tmp_path / "maps" / "maze.yaml"))
        heir = launched.start(Program("heir", "tests.run.heir", argv, log, None))
        while heir.exit_code is None:
            launched.wait(0.1)
    assert log.read_text().split() == ["True", "False"]


def test_robots_in_memory_compute_the_walls_distances_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    maps = tmp_path / "maps"
    shutil.copytree(MAPS, maps)
    with Image.open(maps / "corridor.png") as image:
        image.load()
    before = load_map(maps / "corridor.yaml").cells.copy()
    image.putpixel((0, 0), 0 if image.getpixel((0, 0)) else 255)
    image.save(maps / "corridor.png")
    assert (
        load_map(maps / "corridor.yaml").cells != before
    ).any()  # distances that no other test has asked for
    scenario = load_scenario(CHAPTER, Overrides(robots=3, duration=0.2, seed=1))
    own = msgspec.structs.replace(scenario, map=str(maps / "corridor.yaml"))
    planned = plan(own, RunOptions(tmp_path / "out", bus="memory"))
    shapes: list[tuple[int, ...]] = []
    compute = raster.squared_distance

    def counted(mask: NDArray[np.bool_], *limit: int) -> NDArray[np.float64]:
        shapes.append(mask.shape)
        return compute(mask, *limit)

    monkeypatch.setattr(raster, "squared_distance", counted)
    run_in_memory(planned, lambda progress: None)
    assert len(shared_arguments(planned)) == 1
    assert shapes.count(before.shape) == 1  # the others are the fingerprint's


class SlowAtFirst:
    __name__ = "slow"

    def __init__(self) -> None:
        self.compiled = False

    def fingerprint(self) -> bytes:
        begin = time.process_time()
        while not self.compiled and time.process_time() < begin + 2.0:
            pass
        self.compiled = True
        return b"the same each time"


def test_compiling_does_not_count_for_a_steps_timeout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = SlowAtFirst()
    planned = plan(
        load_scenario(None, Overrides(robots=1, duration=1)), RunOptions(tmp_path / "out", isolate=False)
    )
    monkeypatch.setattr(assembly, "KERNELS", (*assembly.KERNELS, slow))
    limited = replace(planned, timeout=Timeout(step_s=1.0))
    assert run_in_memory(limited, lambda progress: None).simulated_s == 1.0
    assert slow.compiled
