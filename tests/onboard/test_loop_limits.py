"""What hardware in the loop cannot do is refused, key by key; what it can do, it does."""

from dataclasses import replace
from pathlib import Path

import pytest

from deploy.laboratory import hardware_in_the_loop
from deploy.laboratory.loop_limits import check, note
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
from deploy.scenario.tables import Scenario
from deploy.usage import OptionError
from tests.swarm.command import ROOT, acrc

HEAD = f'map = "{ROOT}/maps/corridor.yaml"\n[robots]\ncount = 2\n'
CONDUCTOR = "robots that run by their own clocks have nobody who conducts them"
AIR = "the boards' air has path loss and nothing else"


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
        ('[[event]]\nat = 5\nkill = "r1"\n', f"[[event]]: {CONDUCTOR}"),
        ('[[wall]]\nmaterial = "glass"\nx = [1, 2]\ny = [1, 2]\n', f"[[wall]]: {AIR}"),
        ("[[wifi]]\nat = [5, 5]\nchannel = 1\nduty = 0.3\n", f"[[wifi]]: {AIR}"),
        ('[radio]\nwalls = "concrete"\n', f"[radio] walls: {AIR}"),
        ("[radio]\nshadowing_db = 4\n", f"[radio] shadowing_db: {AIR}"),
        ("[radio]\ncorrelation_distance = 4\n", f"[radio] correlation_distance: {AIR}"),
        (
            '[[robot]]\nid = "r1"\nodometry = "stage"\n',
            'odometry = "stage": emulated bases have the errors of a Kobuki, or none',
        ),
        (
            '[radio]\nshadowing_db = 4\n[[event]]\nat = 5\nkill = "r1"\n',
            f"[[event]]: {CONDUCTOR}; [radio] shadowing_db: {AIR}",
        ),
    ],
)
def test_what_emulated_devices_have_not_is_refused_by_name(text: str, asked: str, tmp_path: Path) -> None:
    with pytest.raises(OptionError) as refused:
        check(scenario(tmp_path, text))
    assert str(refused.value) == sentence(asked)


def test_it_is_refused_before_anything_is_started(tmp_path: Path) -> None:
    scenario(tmp_path, "[[wifi]]\nat = [5, 5]\nchannel = 1\nduty = 0.3\n")
    out = tmp_path / "out"
    refused = acrc("run", tmp_path / "scenario.toml", "--hardware-in-the-loop", "--out", out)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr == f"acrc: {sentence(f'[[wifi]]: {AIR}')}\n"
    assert not out.exists()


def test_what_they_have_is_not_refused(tmp_path: Path) -> None:
    check(scenario(tmp_path, '[radio]\npreset = "rosomnet"\nwalls = "air"\nshadowing_db = 0\nchannel = 15\n'))
    check(load_scenario(ROOT / "scenarios" / "head_on.toml"))


def test_walls_of_a_preset_are_said_to_be_left_out(tmp_path: Path) -> None:
    assert note(scenario(tmp_path, "")) == (
        "emulated boards hear through walls: the brick that radio preset 'chapter' has for them is left out"
    )
    assert note(scenario(tmp_path, '[radio]\nwalls = "air"\n')) is None
    assert note(scenario(tmp_path, '[radio]\npreset = "ideal"\n')) is None


@pytest.mark.parametrize(("text", "channel"), [("[radio]\nchannel = 15\n", 15), ("", 26)])
def test_the_boards_are_on_the_scenarios_channel(text: str, channel: int, tmp_path: Path) -> None:
    plan = swarm.plan(scenario(tmp_path, text), RunOptions(tmp_path / "out"))
    ports = hardware_in_the_loop._robot(replace(plan, isolate=False), 0, tmp_path).ports
    assert ports.channel == channel


def test_each_start_of_a_robots_program_in_a_loop_has_an_epoch_of_its_own(tmp_path: Path) -> None:
    robot = hardware_in_the_loop._robot(
        swarm.plan(scenario(tmp_path, ""), RunOptions(tmp_path / "out")), 1, tmp_path
    )
    assert [robot.epochs() for _ in range(3)] == [0, 1, 2]
