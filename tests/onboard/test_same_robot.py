"""The robot on board is the robot of the simulation: the same program, told the same."""

import socket
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from actors.installation.usage import OptionError
from actors.messages import ProcessOrder
from actors.runtime.process_setup import SETUP, setup_bytes
from deploy.fleet import onboard
from deploy.fleet.onboard import Onboard, Ports
from deploy.run import plan, swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.scenario_file import load_scenario
from firmware_bridge.onboard import base
from tests.swarm.command import leftovers

ROOT = Path(__file__).parents[2]
PORTS = Ports("/dev/kobuki", "/dev/beeclick", "/dev/rplidar", 0xBABA, 26, 0.0)


@pytest.fixture
def alone(tmp_path: Path) -> RunPlan:
    """The head-on scenario, for r1 only."""
    whole = swarm.plan(load_scenario(ROOT / "scenarios" / "head_on.toml"), RunOptions(tmp_path / "out"))
    return replace(whole, world=msgspec.structs.replace(whole.world, robots=whole.world.robots[:1]))


def test_set_up_and_module_are_those_of_the_simulation(alone: RunPlan) -> None:
    robot = alone.world.robots[0]
    on_board = onboard.onboard_robot_program(Onboard(alone, PORTS, lambda: 0), start=0)
    simulated = plan.robot_program(alone, robot, ProcessOrder("r1", 0), first_step=0)
    assert simulated.setup is not None and on_board.setup is not None
    spares = msgspec.structs.replace(simulated.setup.process, spares_record=True)
    outlives = msgspec.structs.replace(simulated.setup, process=spares)
    assert on_board == replace(simulated, setup=outlives), "it outlives a full disk"


def test_a_debugger_changes_who_runs_it_and_nothing_else(alone: RunPlan) -> None:
    plain = onboard.onboard_robot_program(Onboard(alone, PORTS, lambda: 0), start=0)
    debugged = onboard.onboard_robot_program(Onboard(alone, PORTS, lambda: 0, debug_port=5678), start=0)
    assert debugged.module == "debugpy"
    assert debugged.argv == ("--listen", "5678", "-m", plain.module, *plain.argv)


def test_what_the_robot_reads_is_the_same_and_base_and_bridge_lie_beside_it(
    alone: RunPlan, tmp_path: Path
) -> None:
    simulated = replace(alone, options=replace(alone.options, out=tmp_path / "simulated"))
    plan.lay_out(simulated)
    onboard.lay_out(Onboard(alone, PORTS, lambda: 0))
    assert sorted(path.name for path in alone.out.iterdir()) == ["r1", "r1.base", "r1.radio"]
    for path in filter(Path.is_file, (simulated.out / "r1").iterdir()):
        assert (alone.out / "r1" / path.name).read_bytes() == path.read_bytes()
    with pytest.raises(OptionError) as refused:
        onboard.lay_out(Onboard(alone, PORTS, lambda: 0))
    assert str(refused.value) == f"--out: {alone.out} has a folder of r1; must be a folder without"


def test_each_start_of_the_program_is_in_an_epoch_of_its_own_and_named_by_its_number(alone: RunPlan) -> None:
    epochs = iter((7, 8, 12))
    prepared = Onboard(alone, PORTS, lambda: next(epochs))
    programs = [onboard.onboard_robot_program(prepared, start) for start in range(3)]
    assert [one.setup.actor.epoch for one in programs if one.setup is not None] == [7, 8, 12]
    names = [one.record.name for one in programs if one.record is not None]
    assert names == ["r1.mcap", "r1.1.mcap", "r1.2.mcap"]


def test_a_port_that_is_taken_is_said_in_the_log_and_nothing_stays(
    alone: RunPlan, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        listen = f"tls/127.0.0.1:{taken.getsockname()[1]}"
        keys = alone.out.parent / "keys"
        keys.mkdir()
        for name in ("authority.pem", "certificate.pem", "key.pem"):
            (keys / name).touch()
        prepared = Onboard(alone, replace(PORTS, listen=listen, keys=str(keys)), lambda: 0)
        onboard.lay_out(prepared)
        onboard.issue(prepared)
        program = onboard.base_program(prepared, 0)
        assert program.setup is not None
        process = msgspec.structs.replace(program.setup.process, with_parent=False)
        file = program.log.parent / SETUP
        file.write_bytes(setup_bytes(msgspec.structs.replace(program.setup, process=process)))
        assert base.main(program.argv) == 2
    assert capsys.readouterr().err == (
        f"{listen}: no laptop can be awaited there: address already in use; end the program that has the "
        "port, or name another address as `listen` in the fleet file\n"
    )
    assert leftovers(alone.out) == []
