"""Simulated runs to collect, with recordings rewritten for other clocks."""

import csv
import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec
import numpy as np

from acrc_testbed.results.result import RunResult
from actors.installation.repository import REPOSITORY
from actors.messages import Drive, FrameReceived, FrameSent, RadioEvent, RadioEvents, SensorData, Transmit
from actors.runtime.codec import decode, encode
from actors.runtime.failure import FailureNote
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import Entry, Note, Recorder, read_recording
from actors.runtime.replay_bus import topic_of
from actors.topic import Message
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

Clock = Callable[[int], int]
_NOTES = {"run": RunNote, "final": FinalNote, "failure": FailureNote}


def clock(offset_us: int = 0, drift_ppm: float = 0.0) -> Clock:
    """Return what a clock shows at `instant`."""
    return lambda instant: instant + offset_us + round(instant * drift_ppm / 1e6)


def noise(seed: int, spread_us: float) -> Callable[[], int]:
    """Latency of a stamp: 1 ms plus exponential noise."""
    generator = np.random.default_rng(seed)
    return lambda: 1000 + int(generator.exponential(spread_us))


def rewrite(
    source: Path,
    target: Path,
    clocks: dict[str, Clock],
    *,
    late: Callable[[], int] = lambda: 0,
    bridge: Clock | None = None,
    lidar: Clock | None = None,
    keep: Callable[[Entry | Note], bool] = lambda item: True,
) -> None:
    """Copy a recording with the instants of a robot's messages converted to its clock in `clocks`.

    `late` is added to the stamps of the radio; `bridge`: the clock of these stamps, if it is another one, and
    `lidar`: that of the scans.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    with Recorder(target, 100_000) as recorder:
        step = 0
        for item in read_recording(source):
            if not keep(item):
                continue
            if isinstance(item, Note):
                recorder.note(item.name, msgspec.json.decode(item.json, type=_NOTES[item.name]))
                continue
            robot = item.key.split("/")[2] if item.key.count("/") == 3 else ""
            if item.payload is None or robot not in clocks:
                continue
            own = clocks[robot]
            message = decode(topic_of(item.key), item.key, item.payload)
            payload = encode(_moved(message, own, bridge or own, lidar or own, late))
            if item.step != step:
                recorder.flush()
                step = item.step
            if item.direction == "in":
                recorder.received(item.key, item.step, item.sequence, payload)
            else:
                recorder.sent(item.key, item.step, item.sequence, payload, hashlib.sha256(payload).digest())


def _moved(message: Message, own: Clock, bridge: Clock, lidar: Clock, late: Callable[[], int]) -> Message:
    replace = msgspec.structs.replace
    match message:
        case SensorData():
            scan = message.scan and replace(message.scan, stamp=lidar(message.scan.stamp))
            return replace(message, instant=own(message.instant), scan=scan)
        case Drive():
            return replace(
                message,
                reports=tuple([*one[:-1], own(one[-1])] for one in message.reports),
                given_up=tuple(replace(one, instant=own(one.instant)) for one in message.given_up),
            )
        case Transmit():
            return replace(
                message, frames=tuple(replace(one, instant=own(one.instant)) for one in message.frames)
            )
        case RadioEvents():
            return replace(message, events=tuple(_stamped(one, bridge, late) for one in message.events))
        case _:
            return message


def _stamped(event: RadioEvent, bridge: Clock, late: Callable[[], int]) -> RadioEvent:
    more = late() if isinstance(event, FrameReceived | FrameSent) else 0
    return msgspec.structs.replace(event, instant=bridge(event.instant) + more)


CROWD = f"""
map = "{REPOSITORY / "maps" / "corridor.yaml"}"

[run]
duration = 60.0
seed = 3

[robots]
count = 4

[places]
preset = "free"
per_robot = 3

[[event]]
at = 10.0
kill = "r4"

[[event]]
at = 30.0
restart = "r2"
"""


def run(scenario: Path, out: Path, duration: float) -> RunResult:
    """Run a scenario in memory."""
    settled = load_scenario(scenario, Overrides(duration=duration))
    return swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)


def copies(run: Path, to: Path, clocks: Mapping[str, Clock], late: Callable[[], int] = lambda: 0) -> Path:
    """Copy robots' recordings with instants converted to their clocks, each into its folder of `to`."""
    for robot, clock in clocks.items():
        for path in sorted((run / robot).glob("*.mcap")):
            rewrite(path, to / robot / path.name, {robot: clock}, late=late)
    return to


def table(path: Path) -> list[dict[str, str]]:
    """Return the rows of a places.csv."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
