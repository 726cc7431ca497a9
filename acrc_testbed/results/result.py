"""Result of a run, gathered from the final records of its processes."""

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
    decode_subject,
    deeco_result,
    navigation_result,
    strategy_outcome,
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
from actors.task.task import TaskDeclaration, TaskOutcome, Value
from actors.world.battery import EnergyReport
from actors.world.sensing import PoseError, WorldReport

S = TypeVar("S", bound=msgspec.Struct)
T = TypeVar("T")
PARENT = "its parent"


class UndeliveredError(AcrcError):
    """Messages lost between processes."""


def count_undelivered(finals: Sequence[tuple[str, FinalNote]], rosters: int) -> tuple[int, tuple[str, ...]]:
    """Return the number of undelivered or surplus messages, and a sentence for each key concerned.

    `finals`: actor and final note of each process. `rosters`: number of start orders from the world that the
    parent process received.
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
    different = [key for key in sorted(sent.keys() | arrived.keys()) if sent[key] != arrived[key]]
    sentences = (
        f"{key}: {sent[key]} sent by {' and '.join(senders[key]) or 'no process'}, "
        f"{arrived[key]} received by {' and '.join(receivers[key]) or 'no process'}"
        for key in different
    )
    return sum(abs(sent[key] - arrived[key]) for key in different), tuple(sentences)


def require_delivery(missing: int, sentences: Sequence[str]) -> None:
    """Raise UndeliveredError if messages were not delivered."""
    if missing:
        raise UndeliveredError(f"{missing} messages were not delivered: {'; '.join(sentences)}")


_PACKAGES: Final = ("deeco", "eclipse-zenoh", "llvmlite", "msgspec", "numba", "numpy", "pymunk")
"""Packages on which a run's result or speed may depend."""


class BranchOrigin(msgspec.Struct, frozen=True):
    """The run from which a branch was made."""

    run: str
    """Its folder."""
    digest: str
    at_s: float
    """Instant of the change, simulated s."""
    changes: tuple[str, ...] = ()
    """Changes as given on the command line."""
    difference: str = ""
    """First message that differs: step, key, field, both values; empty if none."""
    control: str = ""
    """Digest of the control, for a branch with changed settings: the strategy restarted with its old ones."""
    control_difference: str = ""
    """First message that differs from the control; empty if none, or without a control."""


class Origin(msgspec.Struct, frozen=True):
    """Scenario, strategy and software of a run; scenario, seed, key and commit determine its digest."""

    scenario: str = ""
    """Name of the scenario file; its content, with all drawn values, is stored in the run's folder."""
    strategy: str = ""
    """Name in the scenario or `--strategy`."""
    behaviour: str = ""
    """Function of the strategy, `module:function`."""
    settings: dict[str, Any] = {}
    """Settings of the strategy in the scenario; absent ones have the strategy's defaults."""
    commit: str = ""
    """Commit of the testbed, with a plus sign for uncommitted changes; its version outside a clone."""
    versions: dict[str, str] = {}
    """Versions of Python and of `_PACKAGES`."""
    key: str = ""
    """Secret part of the seed; empty: none."""
    navigation: str = ""
    """Preset of navigation; empty in results without it."""
    localisation: str = ""
    """Preset of localisation; likewise."""
    branch: BranchOrigin | None = None
    """Origin of a branch, whose digest also depends on the change; None: not a branch."""


UNKNOWN_ORIGIN: Final = Origin()
"""Origin of a result that is not from a complete run."""


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of each installed package."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


REPORTED_BY_ROBOTS: Final = ("deeco", "navigation", "outcome", "unread")
"""Keys of a result that are reports of the robots' own processes."""
_MAX_REASON: Final = 300
"""Maximum length of a reason, characters."""


class ResultError(AcrcError):
    """Files of a run that do not yield a result."""


_ABSENT: Any = msgspec.UNSET
"""Default of fields that only simulated runs, or only field trials, have; absent in JSON."""


class ClockReport(msgspec.Struct, frozen=True):
    """Interval of a robot's clock in which the clock was not set."""

    from_s: float
    """Its first step, s of the field trial."""
    to_s: float
    """Its last step."""
    offset_s: float
    """Offset against the clock of the reference robot at the first step."""
    drift_ppm: float
    """Rate relative to the reference."""
    error_s: float | None
    """Error bound of aligned instants, 95 % for all robots together; None: unknown, no common frame with the
    reference."""
    scatter_s: float | None
    """Part of it that follows from the frames; the rest is unequal latency of hosts and radio boards
    (AlignmentParameters.latency_spread_us)."""
    surely_within_s: float | None
    """Error bound for any latencies; None: unknown."""
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
    """Result of one robot."""

    task: dict[str, Value]
    """Values of the task by name (`TaskOutcome.robots`)."""
    pose_error: PoseError = _ABSENT
    """Error of its position estimates; not in field trials."""
    driven_m: float | None = None
    """True distance driven or pushed, m; not in field trials."""
    energy: EnergyReport = _ABSENT
    """Energy from its battery; only with simulated batteries."""
    reports: int = _ABSENT
    """From here on in field trials only. Its reports of the task's own type."""
    gave_up: int = _ABSENT
    """Items, of any robot, that it gave up."""
    frames: dict[str, int] = _ABSENT
    """Its frames by outcome, and the number of frames received."""
    lateness_p50_ms: int | None = _ABSENT
    """Latency from a step to the robot's answer, whole ms; None without a recording of its base."""
    lateness_p99_ms: int | None = _ABSENT
    overruns: int | None = _ABSENT
    """Steps that its base skipped because the robot had not answered."""
    round_trip_p50_ms: int | None = _ABSENT
    """Round trip to the simulated medium, whole ms; None with a radio board, or without a recording."""
    round_trip_p99_ms: int | None = _ABSENT
    clock: tuple[ClockReport, ...] = _ABSENT
    recordings: tuple[RecordingReport, ...] = _ABSENT


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a run, simulated or on hardware: content of `run.json` and of `--json`.

    Fields with the default `_ABSENT` are unset (msgspec.UNSET) in one of the two kinds; see `is_simulated`.
    """

    digest: str = _ABSENT
    robots: int
    seed: int = _ABSENT
    simulated_s: float = _ABSENT
    duration_s: float = _ABSENT
    """First step of all robots to the last one; field trials only, in place of `simulated_s`."""
    wall_s: float = _ABSENT
    """Wall time from the first step to the last, s."""
    startup_s: float = _ABSENT
    """Wall time from the start of the command to the first step, s."""
    cpu_s: float = _ABSENT
    """CPU time of all processes, s."""
    real_time_factor: float = _ABSENT
    task: dict[str, Value]
    """Values of the task by name (`TaskOutcome.values`); for cleaning: docs/tables.md."""
    per_robot: dict[str, RobotResult]
    undelivered: int = _ABSENT
    """Messages sent and not received, or received and not sent, over all keys."""
    unread: int = _ABSENT
    """Messages received and never read by their actor."""
    contacts: int | None
    """Contacts between robots, or of robots with walls and obstacles; None without ground truth."""
    people_contacts: int = _ABSENT
    """Contacts of robots with people, not in `contacts`; only with people on the floor."""
    people_contact_s: float = _ABSENT
    """Total duration of these contacts, simulated s; likewise."""
    refused_orders: tuple[str, ...] = _ABSENT
    """Invalid orders from outside, a sentence each."""
    frames: dict[str, int]
    """Radio frames by outcome, and octets sent."""
    radio_bytes_per_robot_s: float
    """Octets on the air per robot and simulated s: whole frames with MAC header and FCS."""
    deeco: DeecoResult
    """Counters of the component model's nodes."""
    navigation: NavigationResult = _ABSENT
    """Outcomes of navigation goals."""
    isolation: str = _ABSENT
    bus: str = _ABSENT
    out: str | None
    direct_reach: float | None = None
    """Share of robot pairs, sampled once a second, whose link delivers half of the longest frames; None if
    there were never two powered robots."""
    not_delivered: tuple[str, ...] = ()
    """Keys counted in `undelivered`, a sentence each."""
    origin: Origin = UNKNOWN_ORIGIN
    """Scenario, strategy, commit and versions."""
    processor: Processor = Processor("")
    """Processor of the run; does not influence the digest."""
    frames_by_robot: dict[str, dict[str, int]] = {}
    """`frames` by robot: outcomes of its own frames, and of the copies of others' frames at it."""
    driven_m: float | None = None
    """True distance driven by all robots, m; None in older results."""
    reported_by_robots: tuple[str, ...] = ()
    """Keys of this result that robots' processes report, so a strategy may forge them; world, radio and
    parent count the others. Empty in older results."""
    refused_reports: tuple[str, ...] = ()
    """Malformed reports of robots, which are not counted, a sentence each."""
    outcome: Outcomes = {}
    """Values returned by behaviours' `outcome()`, by name and robot; after a restart the last ones."""
    warnings: tuple[str, ...] = ()
    """Problems predicted before the run, a sentence each."""
    energy_j: float = _ABSENT
    """Energy used by all robots; only with simulated batteries."""
    declaration: TaskDeclaration
    """The task's metrics and words."""
    task_summary: str
    """Predicate of a sentence about the robots: their achievement."""
    task_notes: tuple[str, ...] = ()
    """Further sentences of the task's judge."""
    held_up: dict[str, StepDelays] = {}
    """Delays of steps by actor, without those of the machine; do not influence the digest."""
    metrics: dict[str, float | None] = _ABSENT
    """Values of the study's own metrics; None: unknown, or not before the end. Absent without."""
    metric_faults: dict[str, str] = _ABSENT
    """Errors of the study's own metrics that could not be computed."""
    reference: str = _ABSENT
    """From here on in field trials only. Robot whose clock is the time base."""
    notes: tuple[str, ...] = _ABSENT
    """Missing or unknown data, a sentence each."""

    @property
    def is_simulated(self) -> bool:
        """False for a field trial, also with emulated devices."""
        return self.reference is _ABSENT

    @property
    def length_s(self) -> float:
        """Time from the first step to the last, s of the run's clock."""
        return self.simulated_s if self.is_simulated else self.duration_s

    @property
    def finished_s(self) -> float:
        """Time of the event of the last metric with one, such as completion; else `length_s`."""
        times = [self.task.get(metric.column) for metric in self.declaration.metrics if metric.event]
        return float(times[-1]) if times and times[-1] else self.length_s


def optional_value(value: T | msgspec.UnsetType) -> T | None:
    """Return a field's value; None if it is absent."""
    return None if value is msgspec.UNSET else value


def field_trial_struct(kind: type[S], **fields: Any) -> S:
    """Return a result of a field trial with these fields; all others are absent in JSON."""
    return kind(**dict.fromkeys(kind.__struct_fields__, _ABSENT) | fields)


def gather_result(
    programs: Sequence[Program],
    notes: Mapping[Path, Mapping[str, str]],
    *,
    step_us: int,
    began_s: float,
    rosters: int,
    declaration: TaskDeclaration,
    **fields: Any,
) -> tuple[RunResult, tuple[Mapping[str, Value], ...]]:
    """Return the result of a run whose processes all exited as planned, and the task's items.

    `notes`: notes of recordings that are on other hosts or already read. `began_s`: start of the command, s
    since the epoch. `rosters`: see `count_undelivered`. `fields`: fields of the result known to the parent.
    """
    finals = [(program, _final(program.record, notes)) for program in programs if program.record is not None]
    world = next(final for program, final in finals if program.actor == "world")
    radio = next(final for program, final in finals if program.actor == "radio")
    world_report, radio_report = world.report(WorldReport), radio.report(RadioReport)
    task = msgspec.json.decode(world.outcome["task"], type=TaskOutcome)
    simulated, robots = in_seconds(world_report.steps * step_us), list(world_report.pose_errors)
    wall = max(world.ended_s - world.started_s, 1e-9)
    missing, sentences = count_undelivered([(program.actor, final) for program, final in finals], rosters)
    pairs = {name: radio_report.frames.pop(name) for name in ("pairs", "pairs_in_reach")}
    reports = robot_reports(
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
        task=dict(task.values),
        task_summary=task.summary,
        task_notes=task.notes,
        declaration=declaration,
        per_robot={
            robot: RobotResult(
                task=dict(task.robots[robot]),
                pose_error=world_report.pose_errors[robot],
                driven_m=world_report.driven[robot],
                energy=world_report.energy.get(robot, _ABSENT),
            )
            for robot in robots
        },
        undelivered=missing,
        not_delivered=sentences,
        unread=world.unread + radio.unread + reports.unread,
        contacts=world_report.contacts,
        people_contacts=world_report.people_contacts,  # type: ignore[arg-type]  # unset without people
        people_contact_s=world_report.people_contact_s,  # type: ignore[arg-type]
        refused_orders=world_report.refused_orders,
        frames=radio_report.frames,
        radio_bytes_per_robot_s=octet_rate(radio_report.frames["bytes_sent"], len(robots) * simulated),
        direct_reach=share(pairs),
        frames_by_robot=radio_report.frames_by_robot,
        deeco=reports.deeco,
        navigation=reports.navigation,
        reported_by_robots=REPORTED_BY_ROBOTS,
        refused_reports=reports.refused,
        processor=processor(),
        driven_m=round(sum(world_report.driven.values()), 3),
        energy_j=_total_energy(world_report),
        outcome=reports.outcomes,
        **fields,
    )
    return result, task.items


def _total_energy(report: WorldReport) -> Any:
    """Return the energy used by all robots, J; `_ABSENT` without batteries."""
    return round(sum(one.used_j for one in report.energy.values()), 3) if report.energy else _ABSENT


class RobotReports(NamedTuple):
    """Combined final notes of all robots."""

    deeco: DeecoResult
    navigation: NavigationResult
    outcomes: Outcomes
    unread: int
    refused: tuple[str, ...]
    """Malformed reports, a sentence each."""


def robot_reports(finals: Iterable[tuple[str, Path, FinalNote]]) -> RobotReports:
    """Combine the final notes of robots' processes; each with its robot and file."""
    refused: list[str] = []
    nodes: list[NodeReport] = []
    navigations: list[NavigationReport] = []
    outcomes: Outcomes = {}
    unread = 0
    for robot, record, final in finals:
        unread += final.unread
        with _collect_refusal(refused, robot, "node"):
            nodes += filter(None, (decode_subject(record, final.outcome, "deeco", NodeReport, "a node"),))
        with _collect_refusal(refused, robot, "navigation"):
            report = decode_subject(
                record, final.outcome, "navigation", NavigationReport, "a robot's navigation"
            )
            navigations += filter(None, (report,))
        with _collect_refusal(refused, robot, "outcome"):
            for name, value in strategy_outcome(record, final.outcome).items():
                outcomes.setdefault(name, {})[robot] = value
    return RobotReports(
        deeco_result(nodes),
        navigation_result(navigations),
        dict(sorted(outcomes.items())),
        unread,
        tuple(refused),
    )


@contextmanager
def _collect_refusal(refused: list[str], robot: str, subject: str) -> Iterator[None]:
    """Append a raised OutcomeError to `refused` as a sentence."""
    try:
        yield
    except OutcomeError as error:
        reason = printable(str(error)[:_MAX_REASON]).replace("\n", " ")
        refused.append(f"{robot}: malformed {subject} report, not counted: {reason}")


def octet_rate(count: int, robot_seconds: float) -> float:
    """Return octets per robot and second; 0 for no time."""
    return round(count / robot_seconds, 3) if robot_seconds else 0.0


def _final(record: Path, notes: Mapping[Path, Mapping[str, str]]) -> FinalNote:
    text = (notes[record] if record in notes else read_notes(record)).get("final")
    if text is None:
        raise ResultError(f"{record}: no final record, although the process exited as planned")
    return decode_note(record, "final", text, FinalNote)
