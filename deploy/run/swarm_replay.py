"""Replay of a simulated run in memory, and the first difference between two runs."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from acrc_testbed.recordings.record_check import STAMP, check_run, read_contents
from acrc_testbed.recordings.record_replay import recorded_code
from acrc_testbed.recordings.run_recordings import all_recordings, read_setup, recordings
from acrc_testbed.recordings.sandboxed_replay import warn_about_missing_hashes
from actors.instant import in_seconds
from actors.messages import DRIVE, RECEIVED, ROSTER, SENSES, TRANSMIT, TRUTH, Truth
from actors.processes.launcher import scratch_folder
from actors.processes.robot_logs import ALL_ROBOTS, printing_new_lines
from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.code_permit import Permit, permitted_folders
from actors.runtime.codec import decode
from actors.runtime.recording import Entry, read_recording
from actors.runtime.replay_bus import ReplayError, first_difference, topic_of
from actors.topic import Message, sender
from actors.wording import short_repr
from cleaning.strategies import entry
from deploy.run import swarm
from deploy.run.change import OrderReplayBus, recorded_orders
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario, module_folders

SCENARIO: Final = "scenario.toml"
INFRASTRUCTURE: Final = ("world", "radio")
CAUSAL_ORDER: Final = tuple(topic.pattern for topic in (RECEIVED, SENSES, TRANSMIT, DRIVE, ROSTER, TRUTH))
"""Topics of a step, causes before effects: SensorData counts RadioEvents. RadioAdvanced is a step earlier."""


@dataclass(frozen=True)
class SwarmReplay:
    """Result of a replay without differences from its recording."""

    digest: str
    messages: int
    orders: int
    """Number of replayed external orders."""
    complete: bool
    """True if the recorded run ended as planned; if not, only its intact part was compared."""


def replay_swarm(out: Path, *, permit: Permit) -> SwarmReplay:
    """Replay the run in the folder `out`, and compare all messages sent and received.

    Raises ReplayError at the first difference, with step, message and field; AcrcError for code that the
    permit does not cover, that is missing, or that differs from the recorded code.
    """
    if not (out / SCENARIO).is_file():
        raise ReplayError(f"{out}: contains no {SCENARIO}; give the folder of a simulated run")
    report = check_run(out, strict=False)
    scenario = load_scenario(out / SCENARIO)
    modules = permitted_folders(
        out / SCENARIO, entry(scenario.run.strategy), module_folders(scenario), permit
    )
    files = all_recordings(out)
    missing = [actor for actor in INFRASTRUCTURE if actor not in files]
    if missing:
        raise ReplayError(f"{out}: no recording of the {missing[0]} to compare with")
    orders = OrderReplayBus(recorded_orders(files["world"]))
    with scratch_folder() as folder:
        replay_out = folder / "again"
        recorded = None  # not compared for trusted code
        if modules and not permit.trust and (recorded := recorded_code(out)) is None:
            warn_about_missing_hashes(out)
        # equal detail: recorded content is compared, too
        detail = read_setup(files["radio"], RadioSetup, "a radio").detail
        options = RunOptions(
            replay_out, bus="memory", json=True, modules=modules, recorded=recorded, record=detail
        )
        plan = swarm.plan(scenario, options)
        with printing_new_lines(replay_out, (ALL_ROBOTS,)) as look:
            result = swarm.run_in_memory(plan, lambda progress: look(), orders)
        if not report.complete or result.digest != report.digest:
            until = math.inf if report.complete else (report.good_until or 0)
            difference = divergence(out, replay_out, plan.world.step_us, ("recording", "replay"), until)
            if difference is not None:
                raise ReplayError(difference.words)
            if report.complete:
                raise ReplayError(f"{out}: recorded digest {report.digest}, replayed {result.digest}")
    return SwarmReplay(report.digest, report.messages, orders.orders_published, report.complete)


@dataclass(frozen=True)
class Divergence:
    """The first difference between two runs."""

    step: int
    key: str
    words: str
    """Step, message, field and both values, as text."""
    robots: Mapping[str, float]
    """Time of each robot's first difference, s; absent: none."""


class _Difference(NamedTuple):
    """A message that differs between two runs or is missing in one; sorts in causal order."""

    step: int
    rank: int
    key: str
    one: bytes | None
    """Hash of the message in the first run; None: missing."""
    other: bytes | None


class _MessageHashes:
    """Hashes of all messages sent and received by world and radio of one run, by key."""

    def __init__(self, out: Path) -> None:
        self._files = recordings(out)
        self.by_key: dict[str, dict[tuple[int, int], bytes]] = {}
        """By step and index among the key's messages of that step."""
        for actor in INFRASTRUCTURE:
            for (_, key), trail in read_contents(actor, self._files[actor]).trails.items():
                numbers: Counter[int] = Counter()
                hashes = self.by_key.setdefault(key, {})
                for step, sha256 in STAMP.iter_unpack(bytes(trail)):
                    hashes.setdefault((step, numbers[step]), sha256)
                    numbers[step] += 1

    def message(self, key: str, sha256: bytes | None) -> Message | None:
        """Return the message with this hash from a receiver's recording."""
        receivers = (key.split("/")[2], *INFRASTRUCTURE)
        for path in (path for actor, path in self._files.items() if actor.split(".")[0] in receivers):
            for item in read_recording(path) if sha256 else ():
                if isinstance(item, Entry) and item.sha256 == sha256 and item.payload is not None:
                    return decode(topic_of(key), key, item.payload)
        return None


def divergence(
    one: Path, other: Path, step_us: int, names: tuple[str, str] = ("run", "branch"), until: float = math.inf
) -> Divergence | None:
    """Return the first difference between the recordings of two runs; `until`: last step.

    Ordered jammers and frame losses are ignored: they are changes, not consequences. For a branch only
    topics in CAUSAL_ORDER are compared: others contain the orders, too.
    """
    first, second = _MessageHashes(one), _MessageHashes(other)
    differences = sorted(
        difference
        for key in dict.fromkeys((*first.by_key, *second.by_key))
        if topic_of(key).pattern in CAUSAL_ORDER
        or ("branch" not in names and not topic_of(key).is_from_outside)
        for difference in _differences(key, first.by_key.get(key, {}), second.by_key.get(key, {}))
        if difference.step <= until
    )
    robots: dict[str, float] = {}
    for difference in differences:
        if (robot := sender(difference.key)) is not None:
            robots.setdefault(robot, in_seconds(difference.step * step_us))
    for difference in differences:
        if (words := _describe(difference, first, second, names)) is not None:
            step, key = difference.step, difference.key
            return Divergence(step, key, f"step {step}: {key}: {words}", robots)
    return None


def _differences(
    key: str, one: Mapping[tuple[int, int], bytes], other: Mapping[tuple[int, int], bytes]
) -> Iterator[_Difference]:
    """Yield the differences on a key: all of `Truth`, which contains orders; of others the first."""
    pattern = topic_of(key).pattern
    rank = CAUSAL_ORDER.index(pattern) if pattern in CAUSAL_ORDER else len(CAUSAL_ORDER)
    for place in sorted(one.keys() | other.keys()):
        if one.get(place) != other.get(place):
            yield _Difference(place[0], rank, key, one.get(place), other.get(place))
            if key != TRUTH.key():
                return


def _describe(
    difference: _Difference, first: _MessageHashes, second: _MessageHashes, names: tuple[str, str]
) -> str | None:
    """Describe a difference; None if only jammers or ordered frame losses differ."""
    then = first.message(difference.key, difference.one)
    now = second.message(difference.key, difference.other)
    if difference.one is None:
        return f"only in the {names[1]}: {short_repr(now)}"
    if difference.other is None:
        return f"only in the {names[0]}: {short_repr(then)}"
    if isinstance(now, Truth) and isinstance(then, Truth):
        now, then = (msgspec.structs.replace(truth, jams=(), losses=()) for truth in (now, then))
        if now == then:
            return None
    found = None if now is None or then is None else first_difference(now, then)
    if found is None:
        return "bytes differ"
    return f"{found.field} is {short_repr(found.one)}; in the {names[0]} it was {short_repr(found.other)}"
