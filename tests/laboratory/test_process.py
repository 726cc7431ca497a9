"""The laboratory as a process, with hosts at its pseudo-terminals, in real time."""

import math
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import START
from actors.messages import NO_ECHO_MM, Scan
from actors.radio.radio_model import RadioSetup
from actors.runtime.errors import AcrcError
from actors.world.body import Bodies
from firmware_bridge.laboratory.__main__ import main
from firmware_bridge.laboratory.laboratory import LIDAR
from firmware_bridge.laboratory.laboratory_setup import LaboratorySetup
from firmware_bridge.serial_port import PortError
from tests.laboratory.hosts import ROOT, STARTS, BaseHost, LidarHost, Running, setup, until


def millimetres(scan: Scan) -> NDArray[np.int64]:
    return np.frombuffer(scan.ranges_mm, "<u2").astype(np.int64)


@pytest.mark.alone
def test_a_robot_sees_what_the_world_shows_and_drives_as_far_as_its_base_says(tmp_path: Path) -> None:
    built_from = setup(2)
    with Running(tmp_path, built_from) as laboratory:
        lidar = LidarHost(laboratory.path("r1", "range"))
        base = BaseHost(laboratory.path("r1", "base"))
        until(lambda: len(lidar.scans) >= 2 and base.driver.found, lidar, base)
        base.wanted = (0.2, 0.4)
        until(lambda: base.driver.odometry.heading > 1.2, lidar, base)
        base.wanted = (-0.1, 0.0)
        until(lambda: base.driver.odometry.read().vx < -0.09, lidar, base)
        base.wanted = (0.0, 0.0)
        until(lambda: base.driver.odometry.read().vx == 0.0, lidar, base)
        began_waiting = base.driver.reception.frames
        until(lambda: base.driver.reception.frames > began_waiting + 10, lidar, base)
        odometry = base.driver.odometry.read()
        path = laboratory.path("r1", "range")
        assert laboratory.say("unplug r1 range") == "ok"
        assert not path.is_symlink()
        with pytest.raises(PortError):
            until(lambda: False, lidar)
        assert laboratory.say("unplug r1 range") == "the range of r1 is not plugged in; plug it first"
        assert laboratory.say("plug r1 range") == laboratory.say("reboot r1 radio") == "ok"
        assert path.is_symlink()
        lidar.close()
        base.close()
        result = laboratory.end(signal.SIGINT)
    assert not laboratory.links.exists()

    world = Bodies(built_from.world).senses(0, 0, START, 0, False).scan
    assert world is not None
    seen, true = millimetres(lidar.scans[0]), millimetres(world)
    true[true > 1000 * LIDAR.range_max] = NO_ECHO_MM
    both = (seen != NO_ECHO_MM) & (true != NO_ECHO_MM)
    assert both.sum() > 0.95 * (true != NO_ECHO_MM).sum() > 450
    assert np.median(np.abs(seen - true)[both]) <= 30
    ahead = 319  # of the 640 rays this one points to r2
    assert true[ahead] == pytest.approx(2000 + 100 - 177, abs=10)  # the sensor stands 0.1 m behind the middle
    assert seen[ahead] == pytest.approx(true[ahead], abs=30)

    truth = result.robots["r1"]
    believed = Pose(*STARTS[0]).compose(Pose(odometry.x, odometry.y, odometry.heading))
    assert math.dist(believed.point, truth.pose[:2]) < 0.01 * truth.travelled + 0.002
    assert believed.heading == pytest.approx(truth.pose[2], abs=math.radians(0.5))
    assert truth.travelled > 0.5
    assert result.bases["r1"]["skipped"] == 0
    assert result.boards["r1"]["reboots"] == 1
    assert [place.reached_by for place in result.places] == ["r1", "r1"]
    assert all(place.reached_at is not None for place in result.places)
    assert result.robots["r2"].pose == STARTS[1]
    assert sum(result.behind_ms.values()) == round(100 * result.simulated_s)


@pytest.mark.alone
def test_time_that_cannot_be_made_up_is_left_out_and_counted(tmp_path: Path) -> None:
    with Running(tmp_path, setup(1), "--duration", "2") as laboratory:
        laboratory.pause(1.5)
        result = laboratory.end(None)
    assert result.lost_ms >= 900  # of the pause all but half a second, and some slack
    assert result.simulated_s == 2.0
    assert sum(result.behind_ms.values()) == 200
    assert "ms behind; " in laboratory.complaints
    assert not laboratory.links.exists()


def test_it_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    file = tmp_path / "setup.json"
    file.write_bytes(msgspec.json.encode(setup(1)))
    words = f"--setup {file} --links {tmp_path}/links --result {tmp_path}/result.json --with-parent"
    command = f"{sys.executable} -m firmware_bridge.laboratory {words} & wait"
    with subprocess.Popen(["sh", "-c", command], cwd=ROOT, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"ready\n"
        assert (tmp_path / "links/r1/base").readlink().parent == Path("/dev/pts")
        parent.kill()
        assert parent.stdout.read() == b""  # closed: nobody is left who could write to it
    assert (tmp_path / "result.json").is_file()
    assert not (tmp_path / "links").exists()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (None, "/setup.json: no set-up of a laboratory: world is missing, but must be there"),
        (
            {"radio": {"seed": 1, "step_us": 100_000, "robots": [["r1", 1]]}},
            "/setup.json: no set-up of a laboratory: robots r1, r2 and addresses of r1; "
            "each robot should have one name and one address",
        ),
        (
            {"radio": {"seed": 1, "step_us": 1, "robots": [["r1", 1], ["r2", 2]], "preset": "loud"}},
            "Radio preset 'loud' is unknown; known are chapter, beeclick, rosomnet, ns3, ideal.",
        ),
    ],
)
def test_a_set_up_that_does_not_fit_is_refused(
    change: dict[str, object] | None, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "setup.json"
    given = {} if change is None else msgspec.json.decode(msgspec.json.encode(setup(2))) | change
    file.write_bytes(msgspec.json.encode(given))
    assert main(["--setup", str(file), "--links", str(tmp_path), "--result", str(tmp_path / "r")]) == 2
    assert capsys.readouterr().err.removeprefix(str(tmp_path)) == f"{sentence}\n"


def test_links_that_cannot_be_are_told_and_nothing_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, links = tmp_path / "setup.json", tmp_path / "links"
    file.write_bytes(msgspec.json.encode(setup(2)))
    (links / "r2").mkdir(parents=True)
    (links / "r2" / "radio").write_text("mine")
    assert main(["--setup", str(file), "--links", str(links), "--result", str(tmp_path / "r")]) == 2
    assert capsys.readouterr().err == (
        f"{links}/r2/radio: there is something that is no link; give a path where a link can be made\n"
    )
    assert [path.relative_to(links) for path in links.rglob("*")] == [Path("r2"), Path("r2/radio")]


def test_a_robots_name_must_do_as_a_folder() -> None:
    body = msgspec.structs.replace(setup(1).world.robots[0], id="../r1")
    world = msgspec.structs.replace(setup(1).world, robots=(body,))
    with pytest.raises(AcrcError, match=r"a robot '../r1'; its name should do as a folder's"):
        LaboratorySetup(world, RadioSetup(1, 100_000, (("../r1", 1),)))
