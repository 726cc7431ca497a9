"""Two emulated TurtleBots 4 and a TurtleBot 3 do the scenario head_on as a fleet; adaptation by radio."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from actors.geometry import Pose
from actors.installation.repository import REPOSITORY
from actors.task.loading import DEFAULT, task_setup
from actors.world.world_setup import BodySetup, WorldSetup
from tests.laboratory.hosts import Running, setup
from tests.ros2.emulation import TurtlebotProcess
from tests.swarm.command import acrc

MODELS = ("turtlebot4", "turtlebot4", "turtlebot3_burger")
STARTS = (Pose(12.44, 4.4, 1.57), Pose(13.7, 11.8, 3.14), Pose(17.0, 12.3, 0.0))
PLACES = (
    [[9.0, 12.5], [15.0, 11.5], [12.4, 13.0]],
    [[12.3, 5.0], [12.6, 3.0], [12.2, 6.0]],
    [[19.0, 12.3], [17.0, 11.9]],
)
LIMIT_S = 420.0


def fleet_text(links: Path, router: str) -> str:
    """Return a fleet file with the settings of the scenario."""
    scenario = (REPOSITORY / "scenarios/head_on.toml").read_text()
    tables = re.split(r"^(?=\[)", scenario, flags=re.MULTILINE)
    kept = ("[localisation]", "[navigation]", "[planner]", "[local_map]", "[dwa]", "[[area]]")
    parts = [f'map = "{REPOSITORY}/maps/corridor.yaml"\n', *(one for one in tables if one.startswith(kept))]
    for number, (model, start, places) in enumerate(zip(MODELS, STARTS, PLACES, strict=True), start=1):
        parts.append(
            f'[[robot]]\nid = "r{number}"\naddress = {number}\nmodel = "{model}"\nstart = {list(start)}\n'
            f'places = {places}\nradio = "{links}/r{number}/radio"\n[robot.base]\nkind = "ros2"\n'
            f'router = "{router}"\nnamespace = "/r{number}"\n'
        )
    return "\n".join(parts)


def reported(out: Path) -> int:
    """Return the number of places that the robots have reported so far."""
    done = acrc("fleet", "collect", out, "--json")
    if done.returncode:  # no robot has begun
        return 0
    count: int = msgspec.json.decode(done.stdout)["task"]["places_reported"]
    return count


@pytest.mark.nightly
@pytest.mark.timeout(0)
def test_a_fleet_does_its_places_and_its_recordings_replay(tmp_path: Path) -> None:
    bodies = tuple(
        BodySetup(id=f"r{number}", model=model, sensor=None, odometry="kobuki", start=start)
        for number, (model, start) in enumerate(zip(MODELS, STARTS, strict=True), start=1)
    )
    map_file = str(REPOSITORY / "maps/corridor.yaml")
    world = WorldSetup(map_file, 1, 100_000, 1_000_000, bodies, task_setup(DEFAULT, {}))
    out, fleet = tmp_path / "runs" / "trial", tmp_path / "fleet.toml"
    with TurtlebotProcess(tmp_path, world) as robots, Running(tmp_path, setup(3)) as radios:
        fleet.write_text(fleet_text(radios.links, robots.router))
        processes = [start_robot(fleet, body.id, out) for body in bodies]
        try:
            wait_for_places(out, sum(map(len, PLACES)))
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            for process in processes:
                process.wait(30.0)
    for body in bodies:
        replayed = acrc("replay", out, "--robot", body.id)
        assert replayed.returncode == 0, replayed.stderr


def start_robot(fleet: Path, robot: str, out: Path) -> "subprocess.Popen[bytes]":
    command = ("fleet", "onboard", fleet, "--robot", robot, "--out", out, "--at", "start")
    with (fleet.parent / f"{robot}.log").open("wb") as log:
        words = [sys.executable, "-m", "acrc_testbed.command_line", *map(str, command)]
        return subprocess.Popen(words, cwd=REPOSITORY, stdout=log, stderr=log)


def wait_for_places(out: Path, expected: int) -> None:
    deadline, done = time.monotonic() + LIMIT_S, 0
    while done < expected:
        assert time.monotonic() < deadline, f"{done} of {expected} places"
        time.sleep(10.0)
        done = reported(out)
