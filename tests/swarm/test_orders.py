"""Orders to a run in progress: executed at a step boundary, recorded and replayed."""

import json
import re
import time
from pathlib import Path

import pytest

from acrc_testbed.recordings.record_replay import replay_actor
from actors import orders as given
from actors.installation.usage import OptionError
from actors.robot.behaviour.code_permit import INSTALLED
from deploy.run import order_bus
from deploy.run.swarm_replay import replay_swarm
from tests import in_process
from tests.failures.failing import stepping, until
from tests.swarm.command import ROOT, begin, leftovers, processes_of


@pytest.mark.parametrize(
    ("words", "order"),
    [
        ("freeze r1", given.Freeze("r1")),
        ("move r1 1 -2.5 0", given.Move("r1", 1.0, -2.5, 0.0)),
        ("jam 1 2 3 4.5", given.StartJam(1.0, 2.0, 3.0, 4_500_000)),
        ("obstacle 1 2 0.3", given.Obstacle(1.0, 2.0, 0.3)),
        ("wall 1 2 3 4", given.Wall(1.0, 2.0, 3.0, 4.0)),
        ("give r2 9 12.5", given.ItemAssignment("r2", ((9.0, 12.5),))),
        ("close 12.5 9.4", given.CloseDoor(12.5, 9.4)),
        ("open 12.5 9.4", given.OpenDoor(12.5, 9.4)),
        ("pause", given.Pause()),
        ("step", given.Step(1)),
        ("step 20", given.Step(20)),
        ("speed 0.5", given.Speed(0.5)),
        ("speed max", given.Speed(0.0)),
    ],
)
def test_orders_as_typed(words: str, order: given.Order) -> None:
    verb, *rest = words.split()
    assert order_bus.parse(verb, rest) == order


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("kill", "VERB: kill; must be like kill ROBOT"),
        ("move r1 a b c", "VERB: 'move r1 a b c'; must be like move ROBOT X Y HEADING"),
        ("pause now", "VERB: 'pause now'; must be like pause"),
        ("step 1 2", "VERB: 'step 1 2'; must be like step [N]"),
        ("step 0", "step.steps is 0, but must be from 1 to 1000000"),
        ("speed 0", "VERB: 'speed 0'; must be like speed X|max"),
        ("speed -1", "speed.factor is -1, but must be from 0.01 to 1e+06"),
        ("wall 0 0 100 0", "wall.length is 100, but must be from 0 to 75"),
        ("jam 0 0 5 inf", "VERB: 'jam 0 0 5 inf'; must be like jam X Y RADIUS SECONDS"),
        ("jam 0 0 5 1e10", "jam.duration is 1e+10, but must be above 0 and at most 1e+06"),
        ("jam 0 0 -5 1", "jam.radius is -5, but must be above 0 and at most 1e+06"),
        ("obstacle nan 0 1", "obstacle.x is nan, but must be from -1e+06 to 1e+06"),
    ],
)  # fmt: skip
def test_wrong_orders_are_refused(words: str, sentence: str) -> None:
    verb, *rest = words.split()
    with pytest.raises(OptionError) as caught:
        order_bus.parse(verb, rest)
    assert str(caught.value) == sentence


def test_a_run_is_paused_changed_resumed_stopped_and_replayed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    corridor = ROOT / "scenarios" / "corridor.toml"
    process = begin("run", corridor, "--duration", 100_000, "--speed", 5, "--out", out, "--json")
    until(lambda: stepping(out), timeout_s=90.0)
    about = [Path(f"/proc/{pid}") for pid in processes_of(out) if pid != process.pid]
    names = {(folder / "comm").read_text().strip() for folder in about}
    lines = {(folder / "cmdline").read_bytes().rstrip(b"\0").decode() for folder in about}
    assert names == lines >= {"acrc world", "acrc radio", "acrc r1", "acrc r2"}

    def order(*words: object) -> None:
        done = in_process.acrc("order", out, *words)
        assert done.returncode == 0, done.stderr
        assert done.stdout == f"acrc: order executed: {' '.join(map(str, words))}\n"

    refused = in_process.acrc("order", out, "thaw", "r9")
    assert refused.returncode == 1 and refused.stdout == ""
    assert re.fullmatch(
        r"acrc: the run refused the order 'thaw r9' at [\d.]+ s: cannot thaw 'r9': no such robot\n",
        refused.stderr,
    )
    order("pause")
    world = out / "world" / "world.mcap"
    size = 0
    while size != (size := world.stat().st_size):
        time.sleep(0.3)
    order("move", "r1", 3.0, 12.0, -1.0)
    order("restart", "r2")
    order("resume")
    until((out / "r2" / "r2.1.mcap").exists)
    until(lambda: world.stat().st_size > size)
    order("stop")
    said, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    result = json.loads(said)
    assert result["undelivered"] == result["unread"] == 0
    assert processes_of(out) == [] and leftovers(out) == []
    assert replay_actor(out, "r2.1").outputs > 0
    assert in_process.acrc("record", "check", out).returncode == 0
    again = replay_swarm(out, permit=INSTALLED)
    assert (again.digest, again.orders, again.complete) == (result["digest"], 6, True)


def test_an_ended_run_takes_no_orders(tmp_path: Path) -> None:
    done = in_process.acrc("order", tmp_path, "stop")
    assert done.returncode == 1
    assert done.stderr.strip() == (
        f"acrc: {tmp_path}: no run is in progress here; give the folder of a running zenoh run"
    )
