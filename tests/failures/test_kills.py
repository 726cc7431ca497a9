"""A killed process and Ctrl-C end the run, which names the cause and leaves nothing behind."""

import os
import signal
from pathlib import Path

import pytest

from actors.robot.behaviour.foreign import INSTALLED
from deploy.branches.swarm_replay import replay_swarm
from observation.replay.record_replay import replay_actor
from tests import in_process
from tests.failures.failing import Death, gone, killed, last_step, process_of, started, until
from tests.swarm.command import begin, start

pytestmark = pytest.mark.usefixtures("forked_servers")


@pytest.fixture(scope="module")
def r2_killed(tmp_path_factory: pytest.TempPathFactory) -> Death:
    """For all who look at what it left."""
    return killed(tmp_path_factory.mktemp("r2") / "out", "r2", "forkserver")


@pytest.mark.parametrize(
    ("actor", "spawn"),
    [
        ("world", "exec"),
        *(
            pytest.param(actor, spawn, marks=pytest.mark.nightly)
            for actor, spawn in (("radio", "forkserver"), ("world", "forkserver"), ("r2", "exec"))
        ),
    ],
)
def test_a_killed_process_ends_the_run_at_once(tmp_path: Path, actor: str, spawn: str) -> None:
    check_end(killed(tmp_path / "out", actor, spawn), actor)


def test_a_killed_robot_ends_the_run_at_once(r2_killed: Death) -> None:
    check_end(r2_killed, "r2")


def check_end(death: Death, actor: str) -> None:
    assert death.lasted_s < 10  # not the 30 s of a silent actor
    assert death.code == 1
    assert death.said.strip().splitlines()[-1] == f"acrc: {actor} was ended by signal SIGKILL"
    assert gone(death.out)
    steps = {path.stem: last_step(path) for path in death.out.glob("*/*.mcap")}
    # its own last step may be sent and not yet in its file, while the world is in the one after
    assert len(steps) == 4 and abs(max(steps.values()) - steps.pop(actor)) <= 2
    assert max(steps.values()) - min(steps.values()) <= 1


@pytest.mark.parametrize("spawn", ["forkserver", pytest.param("exec", marks=pytest.mark.nightly)])
def test_ctrl_c_ends_the_run_with_130(tmp_path: Path, spawn: str) -> None:
    out = tmp_path / "out"
    process = started(start, out, "--spawn", spawn)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert f"acrc: ended from outside; what was recorded is in {out}" in said
    assert gone(out) and last_step(out / "r1" / "r1.mcap") > 0
    assert in_process.acrc("record", "check", out).returncode == 0


@pytest.mark.parametrize("spawn", ["forkserver", pytest.param("exec", marks=pytest.mark.nightly)])
def test_nothing_is_left_when_acrc_itself_is_killed(tmp_path: Path, spawn: str) -> None:
    out = tmp_path / "out"
    process = started(start, out, "--spawn", spawn)
    process.kill()
    process.wait()
    until(lambda: gone(out), timeout_s=5.0)


@pytest.mark.parametrize("spawn", ["exec", pytest.param("forkserver", marks=pytest.mark.nightly)])
def test_no_password_is_left_when_world_and_acrc_are_killed(tmp_path: Path, spawn: str) -> None:
    out = tmp_path / "out"
    process = started(begin, out, "--spawn", spawn)
    process.send_signal(signal.SIGSTOP)  # else it might tidy up after the world
    os.kill(process_of(out, "world"), signal.SIGKILL)
    process.kill()
    process.wait()
    until(lambda: gone(out), timeout_s=10.0)


def test_a_run_that_was_cut_can_be_replayed_up_to_the_cut(r2_killed: Death) -> None:
    assert replay_actor(r2_killed.out, "r2").outputs > 0
    again = replay_swarm(r2_killed.out, permit=INSTALLED)
    assert again.messages > 0 and not again.complete
