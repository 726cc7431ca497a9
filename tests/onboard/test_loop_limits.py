"""What hardware in the loop cannot do is refused, key by key; what it can do, it does."""

from dataclasses import replace
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.instant import Instant
from actors.radio.radio_model import PRESETS
from deploy.laboratory import hardware_in_the_loop
from deploy.laboratory.hardware_in_the_loop import check_limits
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
from deploy.scenario.tables import Scenario
from firmware_bridge.laboratory.laboratory import Laboratory
from firmware_bridge.laboratory.laboratory_setup import LaboratorySetup
from tests.swarm.command import ROOT, acrc

HEAD = f'map = "{ROOT}/maps/corridor.yaml"\n[robots]\ncount = 2\n'
CONDUCTOR = "robots that run by their own clocks have nobody who conducts them"


def scenario(folder: Path, text: str, head: str = HEAD) -> Scenario:
    file = folder / "scenario.toml"
    file.write_text(head + text)
    return load_scenario(file)


def sentence(asked: str) -> str:
    return (
        f"--hardware-in-the-loop: the scenario asks for what emulated devices have not: {asked}; "
        "leave it out there, or run the scenario without --hardware-in-the-loop"
    )


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ('[[event]]\nat = 5\nkill = "r1"\n', f"[[event]] kill: {CONDUCTOR}"),
        ('[[event]]\nat = 5\nmove = "r1"\nto = [9, 12.5, 0]\n', f"[[event]] move: {CONDUCTOR}"),
        (
            '[[robot]]\nid = "r1"\nodometry = "stage"\n',
            'odometry = "stage": emulated bases have the errors of a Kobuki, or none',
        ),
        (
            '[[robot]]\nid = "r1"\nodometry = "stage"\n[[event]]\nat = 5\nkill = "r1"\n'
            '[[event]]\nat = 6\nkill = "r2"\n[[event]]\nat = 7\nlose = "r2"\nof = "r1"\n',
            f'[[event]] kill: {CONDUCTOR}; odometry = "stage": '
            "emulated bases have the errors of a Kobuki, or none",
        ),
    ],
)
def test_what_emulated_devices_have_not_is_refused_by_name(text: str, asked: str, tmp_path: Path) -> None:
    with pytest.raises(OptionError) as refused:
        check_limits(scenario(tmp_path, text))
    assert str(refused.value) == sentence(asked)


def test_it_is_refused_before_anything_is_started(tmp_path: Path) -> None:
    scenario(tmp_path, '[[event]]\nat = 5\nfreeze = "r1"\n')
    out = tmp_path / "out"
    refused = acrc("run", tmp_path / "scenario.toml", "--hardware-in-the-loop", "--out", out)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == f"acrc: {sentence(f'[[event]] freeze: {CONDUCTOR}')}\n"
    assert not out.exists()


@pytest.mark.parametrize("name", [*PRESETS, "the shipped scenarios"])
def test_what_they_have_is_not_refused(name: str, tmp_path: Path) -> None:
    """All of the air: presets, walls, materials, shadowing, Wi-Fi, jammers; and the shipped scenarios."""
    if name not in PRESETS:
        for file in ("head_on.toml", "chapter.toml"):
            check_limits(load_scenario(ROOT / "scenarios" / file))
        return
    text = f'[radio]\npreset = "{name}"\nwalls = "concrete"\nshadowing_db = 4\ncorrelation_distance = 1\n'
    text += '[[wall]]\nmaterial = "glass"\nx = [11, 18]\ny = [0, 8]\n'
    text += "[[wifi]]\nat = [5, 12]\nchannel = 1\nduty = 0.3\n"
    text += "[[event]]\nat = 5\njam = [9, 12.5]\nradius = 2\nduration = 1\n"
    text += (
        '[[event]]\nat = 6\nlose = "r1"\nof = "r2"\n[[event]]\nat = 7\nobstacle = [13, 12]\nradius = 0.3\n'
    )
    asked = scenario(tmp_path, text)
    check_limits(asked)
    plan = swarm.plan(asked, RunOptions(tmp_path / "out"))
    laboratory = Laboratory(LaboratorySetup(plan.world, plan.radio))
    laboratory.advance(Instant(20_000), lambda jack, data: None)
    assert laboratory.air.counters()["frames_sent"] == 0


@pytest.mark.parametrize(("text", "channel"), [("[radio]\nchannel = 15\n", 15), ("", 11)])
def test_the_boards_are_on_the_scenarios_channel(text: str, channel: int, tmp_path: Path) -> None:
    plan = swarm.plan(scenario(tmp_path, text), RunOptions(tmp_path / "out"))
    ports = hardware_in_the_loop._robot(replace(plan, isolate=False), 0, tmp_path).ports
    assert ports.channel == channel


def test_each_start_of_a_robots_program_in_a_loop_has_an_epoch_of_its_own(tmp_path: Path) -> None:
    robot = hardware_in_the_loop._robot(
        swarm.plan(scenario(tmp_path, ""), RunOptions(tmp_path / "out")), 1, tmp_path
    )
    assert [robot.epochs() for _ in range(3)] == [0, 1, 2]
