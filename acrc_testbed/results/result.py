"""The result of a run, gathered from the last records of its processes; its origin and frame counts."""

import platform
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import msgspec

from acrc_testbed.results.outcome import (
    DeecoResult,
    NavigationResult,
    OutcomeError,
    Outcomes,
    counted,
    deeco_result,
    navigation_result,
    own_outcome,
    robot_places,
    told,
)
from actors.instant import in_seconds
from actors.messages import ROSTER
from actors.processes.launcher import Program
from actors.processes.monitor import StepDelays
from actors.radio.radio_model import RadioReport, share
from actors.robot.behaviour.decisions import NodeReport
from actors.robot.navigation.navigation_counts import NavigationReport
from actors.runtime.errors import AcrcError, printable
from actors.runtime.process import FinalNote
from actors.runtime.processor import Processor, processor
from actors.runtime.recording import decode_note, read_notes
from actors.runtime.shell import run_digest
from actors.task.referee import PlaceOutcome
from actors.world.sensing import PoseError, WorldReport

S = TypeVar("S", bound=msgspec.Struct)
PARENT = "its parent"


class UndeliveredError(AcrcError):
    """Messages that were lost on the way."""


def undelivered(finals: Sequence[tuple[str, FinalNote]], rosters: int) -> tuple[int, tuple[str, ...]]:
    """Return how many messages were sent and did not arrive, or the other way round; a sentence for each key.

    `finals`: each process's actor, and its last note. `rosters`: how many of the world's orders to start
    robots their parent has received.
    """
    sent, arrived = Counter[str](), Counter({ROSTER.pattern: rosters})
    senders, receivers = defaultdict[str, dict[str, None]](dict), defaultdict[str, dict[str, None]](dict)
    receivers[ROSTER.pattern][PARENT] = None
    for actor, final in finals:
        sent.update(final.sent)
        arrived.update(final.arrived)
        for keys, actors in ((final.sent, senders), (final.arrived, receivers)):
            for key in keys:
                actors[key][actor] = None
    wrong = [key for key in sorted(sent.keys() | arrived.keys()) if sent[key] != arrived[key]]
    words = (
        f"{key}: {' and '.join(senders[key]) or 'nobody'} counted {sent[key]} sent, and "
        f"{' and '.join(receivers[key]) or 'nobody'} {arrived[key]} that arrived"
        for key in wrong
    )
    return sum(abs(sent[key] - arrived[key]) for key in wrong), tuple(words)


def demand_all(missing: int, sentences: Sequence[str]) -> None:
    """UndeliveredError if there are messages that were not delivered."""
    if missing:
        raise UndeliveredError(f"{missing} messages were not delivered: {'; '.join(sentences)}")


_PACKAGES: Final = ("eclipse-zenoh", "llvmlite", "msgspec", "numba", "numpy", "pymunk")
"""Those that a run's result, or its speed, could depend on."""


class BranchOrigin(msgspec.Struct, frozen=True):
    """The run that another one is a branch of."""

    run: str
    """Its folder."""
    digest: str
    at_s: float
    """Where the branch leaves it, simulated s."""
    changes: tuple[str, ...] = ()
    """What was changed, as it was typed."""
    difference: str = ""
    """The first message that came out otherwise: step, key, field, both values; empty if none did."""
    control: str = ""
    """Digest of the control, for a branch with other settings: its strategy made anew with its own values."""
    control_difference: str = ""
    """The first message that came out otherwise than in the control; empty if none did, or without one."""


class Origin(msgspec.Struct, frozen=True):
    """Scenario, strategy and software of a run; scenario, seed, key and commit together determine its
    digest.
    """

    scenario: str = ""
    """Name of the scenario's file; its content, with everything drawn, lies beside the result."""
    strategy: str = ""
    """As the scenario or `--strategy` says."""
    behaviour: str = ""
    """The function that this name stands for, `module:function`."""
    settings: dict[str, Any] = {}
    """Of the strategy, as the scenario says; what is absent is as the strategy has it."""
    commit: str = ""
    """Of this software, with a plus sign where files were changed since; its version outside a clone."""
    versions: dict[str, str] = {}
    """Of Python and of the packages that matter."""
    key: str = ""
    """What all that is random follows from beside the seed; empty: there is none."""
    navigation: str = ""
    """Preset of navigation, as the scenario or `--navigation` says; empty in results that do not say it."""
    localisation: str = ""
    """Preset of localisation; the same."""
    branch: BranchOrigin | None = None
    """Of a branch: where it comes from; its scenario, seed and commit do not determine its digest alone."""


UNKNOWN: Final = Origin()
"""Of what is no whole run."""


def versions() -> dict[str, str]:
    """Of Python, and of each package that is installed."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


OWN_WORD: Final = ("deeco", "navigation", "outcome", "unread")
"""Keys of a result that robots' processes report about themselves."""
_LONGEST: Final = 300
"""Characters of a reason."""


class ResultError(AcrcError):
    """A run whose files do not add up to a result."""


_ABSENT: Any = msgspec.UNSET
"""Default of a field that a field trial, or else a simulated run, does not have: JSON lacks it."""


class ClockReport(msgspec.Struct, frozen=True):
    """One interval of one robot's clock in which the clock was not set."""

    from_s: float
    """Its first step, s of the field trial."""
    to_s: float
    """Its last step."""
    offset_s: float
    """Offset against the clock of the reference robot at the first step."""
    drift_ppm: float
    """Rate relative to the reference."""
    error_s: float | None
    """Bound of the error of aligned instants, 95 % for all robots together; None: unknown, because no frame
    connects the clock with the reference."""
    scatter_s: float | None
    """Part of it that the frames themselves show; the rest is unequal latency of hosts and radio boards
    (AlignmentParameters.unlike_us)."""
    surely_within_s: float | None
    """Bound of the error whatever these latencies; None: unknown."""
    frames: int
    """Frames in common with other clocks."""


class RecordingReport(msgspec.Struct, frozen=True):
    """One recording of a robot."""

    path: str
    epoch: int
    steps: int
    ended: str
    """"as planned", "failed", "cut short" or "damaged"."""


class RobotResult(msgspec.Struct, frozen=True):
    """One robot's part."""

    places_total: int
    """Places that it was given; what follows is about these, whichever robot did or said it."""
    places_done: int | None
    """Reported, and ground truth says that some robot had been within reach by then; None without truth."""
    places_claimed: int
    """Reported, whether true or not."""
    places_given_up: int
    """Given up, and not reported."""
    completion_s: float | None
    """When the last of its places was reported, simulated s; None if not all are done; 0 if it has none."""
    pose_error: PoseError = _ABSENT
    """Error of its position estimates; not in field trials."""
    driven_m: float | None = None
    """Distance that it truly covered, or was pushed, m; not in field trials."""
    reports: int = _ABSENT
    """This and the next: in field trials only. Places, of any robot, that it reported as visited."""
    gave_up: int = _ABSENT
    """Places, of any robot, that it gave up."""
    frames: dict[str, int] = _ABSENT
    """What became of its frames, and how many of others it has heard."""
    lateness_p50_ms: int | None = _ABSENT
    """From a step's instant to the robot's answer, whole ms; None without a record of its base."""
    lateness_p99_ms: int | None = _ABSENT
    overruns: int | None = _ABSENT
    """Steps that its base left out because it had not answered."""
    clock: tuple[ClockReport, ...] = _ABSENT
    recordings: tuple[RecordingReport, ...] = _ABSENT


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a run, simulated or on hardware, as `run.json` and `--json` give it.

    Fields with the default `_ABSENT` are not set (msgspec.UNSET) in one of both kinds; see `is_simulated`.
    """

    digest: str = _ABSENT
    robots: int
    seed: int = _ABSENT
    simulated_s: float = _ABSENT
    duration_s: float = _ABSENT
    """Of a field trial, in place of `simulated_s`: from the first step of all robots to the last one."""
    wall_s: float = _ABSENT
    """From the first step to the last, s."""
    startup_s: float = _ABSENT
    """From the start of the command to the first step, s."""
    cpu_s: float = _ABSENT
    """Of all processes, from their start to their end, s; what the system charged for them."""
    real_time_factor: float = _ABSENT
    places_total: int
    places_done: int | None
    """Reported, and ground truth says that some robot had been within reach by then: the chapter's "number of
    cleaning tasks that were completed" (7.2.2). None without ground truth."""
    places_claimed: int
    """Reported, whether true or not: what the system itself takes for cleaned."""
    places_given_up: int
    """Given up by some robot, and reported by none, neither before nor after."""
    places_lost: int
    """Neither reported nor given up, and at the end in the route of no robot that still has a process: nobody
    knows of them any more."""
    completion_s: float | None
    """When the last place was reported, simulated s: the chapter's "time to complete all the tasks" (7.2.2).
    None unless all are done; without ground truth, unless all are reported."""
    settled_s: float | None
    """When the last place was reported or given up, whichever came first for it, simulated s: the chapter's
    "total running time till system completes or gives up" (7.2.2). None if the run ended before that."""
    last_reached_s: float | None
    """When the last of the places that were reported was, simulated s: what the original testbed computes
    under that name (results/process.py), which knows of no giving up. None if nothing was reported."""
    per_robot: dict[str, RobotResult]
    undelivered: int = _ABSENT
    """Messages that were sent and did not arrive, or the other way round, over all keys."""
    unread: int = _ABSENT
    """Messages received that their actor never took."""
    contacts: int | None
    """Contacts that began, between robots or of a robot with something that does not move; None without
    ground truth."""
    refused_orders: tuple[str, ...] = _ABSENT
    """Orders from outside that made no sense, a sentence each."""
    frames: dict[str, int]
    """What became of the radio frames, by cause, and the octets of those that were sent."""
    radio_bytes_per_robot_s: float
    """Octets on the air per robot and simulated s: whole frames with their MAC header and FCS."""
    deeco: DeecoResult
    """What the robots' nodes of the component model did."""
    navigation: NavigationResult = _ABSENT
    """What became of the goals that behaviours gave to navigation."""
    isolation: str = _ABSENT
    bus: str = _ABSENT
    out: str | None
    direct_reach: float | None = None
    """Share of the pairs of robots, seen once a second, whose link lets half of the longest frames through;
    None if there never were two robots with power."""
    not_delivered: tuple[str, ...] = ()
    """The keys that `undelivered` is about, with who counted what, a sentence each."""
    origin: Origin = UNKNOWN
    """Scenario, strategy, commit and versions."""
    processor: Processor = Processor("")
    """What the run was made on; of no influence on the digest."""
    frames_by_robot: dict[str, dict[str, int]] = {}
    """`frames` for each robot: what became of its own, and of the copies of others' frames. With all robots
    on, the copies at one, and what the others lost before it was sent, add up to all frames of the others."""
    driven_m: float | None = None
    """How far all robots truly came, m; None in results from before this was measured."""
    reported_by_robots: tuple[str, ...] = ()
    """The keys of this result that are what the robots' processes say of themselves: a strategy may have
    written it there. World, radio and parent count all else. Empty in results from before this was said."""
    refused_reports: tuple[str, ...] = ()
    """A sentence for each malformed report of a robot, which is not counted."""
    outcome: Outcomes = {}
    """Values that behaviours' `outcome()` returned, by name and robot; after a restart the last ones."""
    warnings: tuple[str, ...] = ()
    """Failures that were expected before the run, a sentence each."""
    held_up: dict[str, StepDelays] = {}
    """Who has held up steps, by time of its own, not of the machine's; of no influence on the digest."""
    reference: str = _ABSENT
    """This and the next: in field trials only. The robot whose clock gives the time."""
    notes: tuple[str, ...] = _ABSENT
    """What is missing or not known, a sentence each."""

    @property
    def is_simulated(self) -> bool:
        """False for a field trial, also one with emulated devices."""
        return self.reference is _ABSENT

    @property
    def length_s(self) -> float:
        """From the first step to the last, s by the run's own clock."""
        return self.simulated_s if self.is_simulated else self.duration_s


def without_unknown(kind: type[S], **known: Any) -> S:
    """Return a result of a field trial: what only a simulation knows is left out of its JSON."""
    return kind(**dict.fromkeys(kind.__struct_fields__, _ABSENT) | known)


def gather(
    programs: Sequence[Program],
    notes: Mapping[Path, Mapping[str, str]],
    *,
    step_us: int,
    began_s: float,
    rosters: int,
    **known: Any,
) -> tuple[RunResult, tuple[PlaceOutcome, ...]]:
    """Return the result of a run whose processes have all ended as planned, and its places.

    `notes`: of recordings that are not here, or have been read already. `began_s`: wall clock when the
    command began, s since the epoch. `rosters`: see `undelivered`. `known`: fields of the result that the
    parent of the processes knows.
    """
    finals = [(program, _final(program.record, notes)) for program in programs if program.record is not None]
    world = next(final for program, final in finals if program.actor == "world")
    radio = next(final for program, final in finals if program.actor == "radio")
    truth, air = world.report(WorldReport), radio.report(RadioReport)
    places = msgspec.json.decode(world.outcome["places"], type=tuple[PlaceOutcome, ...])
    simulated, robots = in_seconds(truth.steps * step_us), list(truth.pose_errors)
    wall = max(world.ended_s - world.started_s, 1e-9)
    missing, sentences = undelivered([(program.actor, final) for program, final in finals], rosters)
    pairs = {name: air.frames.pop(name) for name in ("pairs", "pairs_in_reach")}
    said = robot_reports(
        (program.actor, program.record, final)
        for program, final in finals
        if program.record is not None and program.actor not in ("world", "radio")
    )
    result = RunResult(
        digest=run_digest([final.digest for _, final in finals]),
        robots=len(robots),
        simulated_s=simulated,
        wall_s=round(wall, 3),
        startup_s=round(world.started_s - began_s, 3),
        real_time_factor=round(simulated / wall, 2),
        **counted(places),
        per_robot={
            robot: RobotResult(
                **robot_places(places, robot),
                pose_error=truth.pose_errors[robot],
                driven_m=truth.driven[robot],
            )
            for robot in robots
        },
        undelivered=missing,
        not_delivered=sentences,
        unread=world.unread + radio.unread + said.unread,
        contacts=truth.contacts,
        refused_orders=truth.refused_orders,
        frames=air.frames,
        radio_bytes_per_robot_s=rate(air.frames["bytes_sent"], len(robots) * simulated),
        direct_reach=share(pairs),
        frames_by_robot=air.frames_by_robot,
        deeco=said.deeco,
        navigation=said.navigation,
        reported_by_robots=OWN_WORD,
        refused_reports=said.refused,
        processor=processor(),
        driven_m=round(sum(truth.driven.values()), 3),
        outcome=said.outcomes,
        **known,
    )
    return result, places


class RobotReports(NamedTuple):
    """Final notes of all robots together."""

    deeco: DeecoResult
    navigation: NavigationResult
    outcomes: Outcomes
    unread: int
    refused: tuple[str, ...]
    """A sentence for each malformed report."""


def robot_reports(finals: Iterable[tuple[str, Path, FinalNote]]) -> RobotReports:
    """Gather the last records of robots' processes, each with its robot and its file."""
    refused: list[str] = []
    nodes: list[NodeReport] = []
    navigations: list[NavigationReport] = []
    outcomes: Outcomes = {}
    unread = 0
    for robot, record, final in finals:
        unread += final.unread
        with _refusing(refused, robot, "node"):
            nodes += filter(None, (told(record, final.outcome, "deeco", NodeReport, "a node"),))
        with _refusing(refused, robot, "navigation"):
            report = told(record, final.outcome, "navigation", NavigationReport, "a robot's navigation")
            navigations += filter(None, (report,))
        with _refusing(refused, robot, "outcome"):
            for name, value in own_outcome(record, final.outcome).items():
                outcomes.setdefault(name, {})[robot] = value
    return RobotReports(
        deeco_result(nodes),
        navigation_result(navigations),
        dict(sorted(outcomes.items())),
        unread,
        tuple(refused),
    )


@contextmanager
def _refusing(refused: list[str], robot: str, subject: str) -> Iterator[None]:
    """Turn an OutcomeError into a sentence."""
    try:
        yield
    except OutcomeError as error:
        why = printable(str(error)[:_LONGEST]).replace("\n", " ")
        refused.append(f"{robot}: its report of its {subject} is malformed and is not counted: {why}")


def rate(count: int, robot_seconds: float) -> float:
    """Octets per robot and second; 0 if there was no time."""
    return round(count / robot_seconds, 3) if robot_seconds else 0.0


def _final(record: Path, notes: Mapping[Path, Mapping[str, str]]) -> FinalNote:
    text = (notes[record] if record in notes else read_notes(record)).get("final")
    if text is None:
        raise ResultError(f"{record}: there is no final record in it, although its process ended as planned")
    return decode_note(record, "final", text, FinalNote)
