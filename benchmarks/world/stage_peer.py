"""The same swarm in Stage, if its program `stage` is installed: what the original simulated with."""

import os
import re
import resource
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from actors.floor.grid import FREE, OccupancyGrid
from actors.runtime.errors import AcrcError
from benchmarks.world.plain_swarm import strewn, turtlebot

_PATIENCE_S: Final = 1800.0
"""After so long a run counts as hung."""
_NAME: Final = re.compile(r"^\s*Stage (\d[\w.]*)")
_CLOCK: Final = re.compile(r"\[Stage:\s+(?:(\d+)h)?\s*(\d+)m (\d+)s (\d+)msec\]")
_DONE: Final = "[Stage: done]"
_WORLD: Final = """\
name "acrc"
interval_sim 100 # ms: the original's, and a scan of each robot in it
quit_time {quit:g}
resolution {resolution:g}
show_clock 1
show_clock_interval 10
threads 1

define floorplan model
(
  color "gray30"
  boundary 0
  gui_nose 0
  gui_grid 0
  gui_move 0
  gui_outline 0
  gripper_return 0
  fiducial_return 0
  ranger_return 1
  obstacle_return 1
)

define lidar ranger
(
  size [0.05 0.05 0.05]
  pose [{sensor_x:g} 0 0 0]
  sensor( range [0 {range_max:g}] fov {fov:g} samples {rays} )
)

define turtlebot position
(
  size [{side:g} {side:g} 0.4]
  drive "diff"
  localization "gps"
  lidar()
  ctrl "wander"
)

floorplan( name "map" bitmap "map.png" size [{width:g} {height:g} 1] pose [{x:g} {y:g} 0 0] )
"""
_ROBOT: Final = 'turtlebot( name "r{number}" pose [{x:.6f} {y:.6f} 0 {degrees:.4f}] )\n'


class StageError(AcrcError):
    """A `stage` that does not run as Stage does."""


@dataclass(frozen=True)
class StageRun:
    """One run of the program."""

    version: str
    reached_s: float
    """Simulated time of the last clock that it printed; it prints one per simulated second."""
    cpu_s: float


def binary() -> str | None:
    """The program; None if there is none."""
    return shutil.which("stage")


def speed(
    grid: OccupancyGrid, robots: int, rays: int, seconds_long: int, repeats: int, seed: int
) -> tuple[str, float] | None:
    """Its version, and simulated seconds per CPU second; None if it is not installed.

    By the difference between a long run and one of a second, which starts and loads as the long one does.
    The least of several counts. Its own controller `wander`, which reads every scan, drives the robots.
    Raises StageError.
    """
    if binary() is None:
        return None
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        short, long = (
            _best(write_world(grid, robots, rays, quit_s, seed, Path(folder)), quit_s, repeats)
            for quit_s in (1, 1 + seconds_long)
        )
    return long.version, seconds_long / max(long.cpu_s - short.cpu_s, 1e-6)


def write_world(grid: OccupancyGrid, robots: int, rays: int, quit_s: int, seed: int, folder: Path) -> Path:
    """The world file of a swarm that ends after so many simulated seconds, its map beside it."""
    model = turtlebot(rays)
    cells = np.where(grid.cells == FREE, 255, 0).astype(np.uint8)
    Image.fromarray(cells[::-1]).save(folder / "map.png")
    width, height = grid.columns * grid.resolution, grid.rows * grid.resolution
    content = _WORLD.format(
        quit=quit_s,
        resolution=grid.resolution,
        sensor_x=model.sensor.x,
        range_max=model.sensor.range_max,
        fov=model.sensor.field_of_view_deg,
        rays=rays,
        side=2 * model.footprint.circumradius,
        width=width,
        height=height,
        x=grid.origin.x + width / 2,
        y=grid.origin.y + height / 2,
    )
    for number, pose in enumerate(strewn(grid, robots, np.random.default_rng(seed)), start=1):
        degrees = float(np.degrees(pose.heading))
        content += _ROBOT.format(number=number, x=pose.x, y=pose.y, degrees=degrees)
    path = folder / f"swarm-{quit_s}.world"
    path.write_text(content)
    return path


def command(world: Path) -> list[str]:
    """Without a window, as fast as it goes, with its clock on standard output."""
    program = binary()
    assert program is not None
    return [program, "-g", "-c", str(world)]


def read(output: str) -> tuple[str, float]:
    """Version and the last clock, s, of a run that came to its end; StageError for anything else."""
    name = _NAME.search(output)
    if name is None or _DONE not in output:
        last = next((line.strip() for line in reversed(output.splitlines()) if line.strip()), "nothing")
        raise StageError(f"stage did not run to its end as Stage does; the last that it said: {last[:200]}")
    clocks = [
        int(hours or 0) * 3600 + int(minutes) * 60 + int(seconds) + int(ms) / 1000
        for hours, minutes, seconds, ms in _CLOCK.findall(output)
    ]
    return name[1], max(clocks, default=0.0)


def _best(world: Path, quit_s: int, repeats: int) -> StageRun:
    return min((_run(world, quit_s) for _ in range(repeats)), key=lambda run: run.cpu_s)


def _run(world: Path, quit_s: int) -> StageRun:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(
            command(world),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            cwd=world.parent,
            env=os.environ | {"LC_ALL": "C"},  # a comma in a number would end it
            timeout=_PATIENCE_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise StageError(f"stage does not run: {error}") from None
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    version, reached_s = read(done.stdout.decode(errors="replace"))
    if reached_s < quit_s - 1:
        raise StageError(f"stage ended after {reached_s:g} of {quit_s} simulated seconds")
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return StageRun(version, reached_s, cpu_s)
