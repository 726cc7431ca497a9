"""What a run comes to: gathered from the last records of its processes' files, and nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.instant import in_seconds
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes
from actors.runtime.tally import run_digest
from actors.world.referee import PlaceOutcome
from deploy.launch import Program


class ResultError(AcrcError):
    """A run whose files do not add up to a result."""


class RobotResult(msgspec.Struct, frozen=True):
    """One robot's part."""

    places_total: int
    places_done: int
    """Of its own places: reported by some robot, and ground truth says that one had been there."""
    completion_s: float | None
    """When the last of its places was reported; None if not all are done."""


class RunResult(msgspec.Struct, frozen=True):
    """The result of a run, as `run.json` and `--json` give it."""

    digest: str
    robots: int
    seed: int
    simulated_s: float
    wall_s: float
    """From the first step to the last, s."""
    startup_s: float
    """From the start of the command to the first step, s."""
    cpu_s: float
    """Of all processes, from their start to their end, s."""
    real_time_factor: float
    places_total: int
    places_done: int
    completion_s: float | None
    """When the last place of all was reported, simulated s; None if not all are done."""
    per_robot: dict[str, RobotResult]
    undelivered: int
    """Messages published less messages received, over all actors."""
    unread: int
    """Messages received that their actor never took."""
    contacts: int
    """Contacts that began, between robots or of a robot with something that does not move."""
    refused_orders: tuple[str, ...]
    """Orders from outside that made no sense, a sentence each."""
    frames: dict[str, int]
    """What became of the radio frames, by cause."""
    isolation: str
    bus: str
    out: str


@dataclass(frozen=True)
class Circumstances:
    """What the result says about the way the run was made."""

    out: Path
    robots: Sequence[str]
    seed: int
    step_us: int
    isolation: str
    bus: str
    began_s: float
    """Wall clock when the command began, s since the epoch."""
    parent_cpu_s: float
    parent_received: int


class WorldOutcome(msgspec.Struct):
    """What the world says about the run."""

    places: tuple[PlaceOutcome, ...]
    contacts: int
    steps: int
    refused_orders: tuple[str, ...]


def gather(programs: Sequence[Program], about: Circumstances) -> RunResult:
    """The result of a run whose processes have all ended as planned."""
    finals = [(program, _final(program.record)) for program in programs if program.record is not None]
    world = next(final for program, final in finals if program.actor == "world")
    radio = next(final for program, final in finals if program.actor == "radio")
    outcome = WorldOutcome(
        **{
            name: msgspec.json.decode(world.outcome[name], type=kind)
            for name, kind in WorldOutcome.__annotations__.items()
        }
    )
    simulated = in_seconds(outcome.steps * about.step_us)
    wall = max(world.ended_s - world.started_s, 1e-9)
    published = sum(final.published for _, final in finals)
    received = sum(final.received for _, final in finals) + about.parent_received
    done, completion = _completion(outcome.places)
    return RunResult(
        digest=run_digest([final.digest for _, final in finals]),
        robots=len(about.robots),
        seed=about.seed,
        simulated_s=simulated,
        wall_s=round(wall, 3),
        startup_s=round(world.started_s - about.began_s, 3),
        cpu_s=round(sum(final.cpu_s for _, final in finals) + about.parent_cpu_s, 3),
        real_time_factor=round(simulated / wall, 2),
        places_total=len(outcome.places),
        places_done=done,
        completion_s=completion,
        per_robot={robot: _robot_result(robot, outcome.places) for robot in about.robots},
        undelivered=published - received,
        unread=sum(final.unread for _, final in finals),
        contacts=outcome.contacts,
        refused_orders=outcome.refused_orders,
        frames=msgspec.json.decode(radio.outcome["frames"], type=dict[str, int]),
        isolation=about.isolation,
        bus=about.bus,
        out=str(about.out),
    )


def _robot_result(robot: str, places: Sequence[PlaceOutcome]) -> RobotResult:
    own = [place for place in places if place.owner == robot]
    done, completion = _completion(own)
    return RobotResult(len(own), done, completion)


def _completion(places: Sequence[PlaceOutcome]) -> tuple[int, float | None]:
    """How many are done, and when the last of them was reported, s, if all are."""
    done = [place.reported_at for place in places if place.done and place.reported_at is not None]
    return len(done), in_seconds(max(done, default=0)) if len(done) == len(places) else None


def _final(record: Path) -> FinalNote:
    text = read_notes(record).get("final")
    if text is None:
        raise ResultError(f"{record}: there is no final record in it, although its process ended as planned")
    return msgspec.json.decode(text, type=FinalNote)
