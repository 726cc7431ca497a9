"""A whole simulated run made again, in memory, from its scenario, its seed and the orders it was given."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from acrc_testbed.recordings.record_check import STAMP, check, read_pass
from acrc_testbed.recordings.record_replay import Onlook, ReplayReport, recorded_code, replay_actor
from acrc_testbed.recordings.run_recordings import all_recordings, setup_of
from acrc_testbed.recordings.sandboxed import say_unhashed
from actors.processes.launch import scratch_folder
from actors.processes.robot_logs import EVERYBODY, shown
from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.foreign import Permit, admitted
from actors.robot.behaviour.loading import RecordedModules
from actors.runtime.codec import decode
from actors.runtime.recording import Direction, Note, read_recording
from actors.runtime.replay_bus import ReplayError, first_difference, topic_of
from actors.wording import brief
from cleaning.strategies import entry
from deploy.run import swarm
from deploy.run.change import OrderBus, recorded_orders
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario, module_folders

SCENARIO: Final = "scenario.toml"
_FOREVER: Final = 1 << 62


@dataclass(frozen=True)
class SwarmReplay:
    """A run that came out the same."""

    digest: str
    messages: int
    orders: int
    """From outside, given again at the same boundaries."""
    complete: bool
    """False: the recorded run did not end as planned; all that it has recorded came out the same."""


def replay_swarm(out: Path, *, permit: Permit) -> SwarmReplay:
    """Make the run in the folder `out` again, and compare everything that anybody sent or took.

    Raises ReplayError at the first difference, naming step, message and field; AcrcError for a
    scenario that names code that the permit does not cover, that is not here, or that is not what the robots
    have recorded.
    """
    if not (out / SCENARIO).is_file():
        raise ReplayError(f"{out}: has no {SCENARIO}; it should be the folder of a simulated run")
    told = check(out, strict=False)
    scenario = load_scenario(out / SCENARIO)
    modules = admitted(out / SCENARIO, entry(scenario.run.strategy), module_folders(scenario), permit)
    files = all_recordings(out)
    missing = [actor for actor in ("world", "radio") if actor not in files]
    if missing:
        raise ReplayError(f"{out}: there is no recording of the {missing[0]}, with which to compare")
    orders = OrderBus(recorded_orders(files["world"]))
    with scratch_folder() as folder:
        again = folder / "again"
        recorded = _recorded(out, modules, permit)
        level = setup_of(
            files["radio"], RadioSetup, "a radio"
        ).detail  # what is only recorded is compared, too
        options = RunOptions(again, bus="memory", json=True, modules=modules, recorded=recorded, record=level)
        plan = swarm.plan(scenario, options)
        with shown(again, (EVERYBODY,)) as look:
            result = swarm.run_in_memory(plan, lambda progress: look(), orders)
        if not told.complete or result.digest != told.digest:
            good_until = _FOREVER if told.complete else (told.good_until or 0)
            _compare(files, all_recordings(again), good_until)
            if told.complete:
                raise ReplayError(f"{out}: its digest is {told.digest}; made again it is {result.digest}")
    return SwarmReplay(told.digest, told.messages, orders.given, told.complete)


def _recorded(out: Path, modules: tuple[Path, ...], permit: Permit) -> RecordedModules | None:
    """What the code must be: what the robots have recorded, where they have, and nobody trusts any other."""
    if permit.trust or not modules:
        return None
    recorded = recorded_code(out)
    if recorded is None:
        say_unhashed(out)
    return recorded


def _compare(recorded: Mapping[str, Path], again: Mapping[str, Path], good_until: int) -> None:
    """Raise ReplayError for what differs first, by step, of all that world and radio sent and took."""
    found: list[tuple[int, str, Direction, str, int]] = []
    for actor in ("world", "radio"):
        one, other = read_pass(actor, recorded[actor]), read_pass(actor, again[actor])
        for (way, key), trail in one.trails.items():
            if topic_of(key).is_from_outside:
                continue
            place = _first_difference(trail, other.trails.get((way, key), bytearray()), good_until)
            if place is not None:
                step, _ = STAMP.unpack_from(trail, place * STAMP.size)
                found.append((step, actor, way, key, place))
    if not found:
        return
    step, actor, way, key, place = min(found)
    raise ReplayError(f"step {step}: {key}: {_in_words(recorded[actor], again[actor], way, key, place)}")


def _first_difference(one: bytearray, other: bytearray, good_until: int) -> int | None:
    """The number of the first message of `one`, up to that step, which `other` has not; None if all agree."""
    for place, (step, sha256) in enumerate(STAMP.iter_unpack(bytes(one))):
        if step > good_until:
            return None
        if other[place * STAMP.size : (place + 1) * STAMP.size] != STAMP.pack(step, sha256):
            return place
    return None


def _in_words(recorded: Path, again: Path, way: Direction, key: str, place: int) -> str:
    """What differs in a message that both have; that there is none, where one has not."""
    then = _payload(recorded, way, key, place)
    now = _payload(again, way, key, place)
    if then is None or now is None:
        return "other bytes than those recorded, of which only the hash is kept"
    topic = topic_of(key)
    found = first_difference(decode(topic, key, now), decode(topic, key, then))
    if found is None:
        return "other bytes for the same message"
    return f"{found.field} is {brief(found.one)}; recorded was {brief(found.other)}"


def _payload(path: Path, way: Direction, key: str, place: int) -> bytes | None:
    """The message of that number on a key; None if it was kept as a hash, or there is none."""
    for number, item in enumerate(_on(path, way, key)):
        if number == place:
            return item
    return None


def _on(path: Path, way: Direction, key: str) -> Iterator[bytes | None]:
    for item in read_recording(path):
        if not isinstance(item, Note) and item.direction == way and item.key == key:
            yield item.payload


def replay_otherwise(out: Path, actor: str, behaviour: str, onlook: Onlook) -> ReplayReport:
    """Execute a robot again with another behaviour, an entry string, on its own settings.

    Raises ReplayError at the first message that it would have sent otherwise: from there on it would have
    sensed and heard other things than were recorded.
    """
    if actor in {"world", "radio"}:
        raise ReplayError(f"{actor}: has no strategy; must be a robot")
    return replay_actor(out, actor, replace(onlook, behaviour=behaviour))
