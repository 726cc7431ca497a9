"""Folder of a campaign: its study, a record for each completed trial, and its frozen plan."""

from collections.abc import Iterator, Sequence
from os.path import realpath
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

import msgspec

from acrc_testbed.experiments import frozen_plan
from acrc_testbed.experiments.frozen_plan import SUFFIX, FrozenPlan, inputs
from acrc_testbed.experiments.study import Study, Trial, differences
from acrc_testbed.experiments.trial_record import CheckRecord, TrialRecord, keep, keep_bytes
from acrc_testbed.results.result import RunResult
from acrc_testbed.results.seal import SUMS, check_seal
from actors.installation.version import changed_since, software_version
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError

_STUDY: Final = "study.json"
_ABOUT: Final = "campaign.json"
_TRIALS: Final = "trials"
_CHECKS: Final = "checks"
_LOGS: Final = "logs"
_LOOKS: Final = "looks.json"
_PLAN: Final = "plan.json"
_OWN: Final = frozenset({_ABOUT, _TRIALS, _CHECKS, _LOGS, _PLAN, "campaign.new", "study.new"})
"""What lies in a folder whose campaign was ended before it had begun."""


class About(msgspec.Struct, frozen=True):
    """What all trials of a campaign have in common beside the study."""

    commit: str
    plan_sha256: str | None = None
    """Of the frozen plan that was there before the first run ended; None: there was none."""
    departures: tuple[str, ...] = ()
    """What its software and its files had otherwise than in the plan whenever it was begun or resumed."""


class Looks(msgspec.Struct, frozen=True):
    """That a campaign was looked at while it went on, which holds from the first time on."""

    cap: int
    """Pairs at most."""
    metric: str


class Pending(NamedTuple):
    """A trial that is to be run, or to be repeated over Zenoh."""

    trial: Trial
    check: bool = False
    """True: to be repeated."""


class Store:
    """A campaign's folder."""

    def __init__(self, folder: Path, study: Study) -> None:
        self.folder = folder
        self.study = study
        self.study_file = folder / _STUDY
        self.about_file = folder / _ABOUT

    def about(self) -> About:
        """What all trials have in common beside the study. Raises AcrcError for a damaged file."""
        return typed_json.read(self.about_file, About, "campaign")

    def pending(self) -> list[Pending]:
        """The trials that have no record yet, in the study's order."""
        return [Pending(trial) for trial in self.study.trials() if not self.path(trial).exists()]

    def unchecked(self, every: int) -> list[Pending]:
        """Return the first trial of each strategy and every Nth from there on, if not repeated yet."""
        own: dict[str, list[Trial]] = {}
        for trial in self.study.trials():
            own.setdefault(trial.strategy, []).append(trial)
        return [
            Pending(trial, check=True)
            for trials in own.values()
            for trial in trials[::every]
            if not self.check_path(trial).exists() and self._has_result(trial)
        ]

    def _has_result(self, trial: Trial) -> bool:
        return self.path(trial).exists() and self.record(trial).result is not None

    def check_path(self, trial: Trial) -> Path:
        """Where the record of a trial's repetition over Zenoh is, or will be."""
        return self.folder / _CHECKS / f"{trial.name}.json"

    def checks(self) -> Iterator[CheckRecord]:
        """Of all trials that were repeated, in the study's order. Raises AcrcError for a damaged one."""
        for trial in self.study.trials():
            if self.check_path(trial).exists():
                yield self.check(trial)

    def check(self, trial: Trial) -> CheckRecord:
        """Of a trial that was repeated. Raises AcrcError for a damaged one."""
        return typed_json.read(self.check_path(trial), CheckRecord, "record of a repeated trial")

    def declare_looks(self) -> None:
        """Keep that this campaign stops early by its rule. Raises AcrcError if it began with another."""
        here = Looks(self.study.seeds, self.study.primary_metric)
        before = self.looks
        if before is not None and before != here:
            raise AcrcError(
                f"{self.folder}: was looked at on the way to {before.cap} pairs; with {here.cap} the error"
                " rate would not hold, so it must stay as it is, or be another campaign"
            )
        keep(self.looks_file, here)

    @property
    def looks(self) -> Looks | None:
        """None if nobody looks before the end."""
        path = self.looks_file
        return typed_json.read(path, Looks, "looks at a campaign") if path.exists() else None

    @property
    def looks_file(self) -> Path:
        """Where it is kept that somebody looks before the end."""
        return self.folder / _LOOKS

    @property
    def commit(self) -> str:
        """What all its trials were made with."""
        return self.about().commit

    @property
    def plan_file(self) -> Path:
        """Where the frozen plan is if there is one."""
        return self.folder / _PLAN

    @property
    def plan(self) -> FrozenPlan | None:
        """The plan from before the first run; None if there was none. Raises AcrcError for another one."""
        known = self.about().plan_sha256
        if known is None:
            return None
        plan = frozen_plan.read(self.plan_file)
        if plan.sha256 != known:
            raise AcrcError(
                f"{self.plan_file}: has SHA-256 {plan.sha256}, but the campaign was begun with {known}"
            )
        return plan

    def path(self, trial: Trial) -> Path:
        """Where a trial's record is, or will be."""
        return self.folder / _TRIALS / f"{trial.name}.json"

    def log(self, trial: Trial, *, check: bool = False) -> Path:
        """What its process says, or that of its repetition."""
        return self.folder / _LOGS / f"{trial.name}{'-check' if check else ''}.log"

    def records(self) -> Iterator[TrialRecord]:
        """Of all trials that have ended, in the study's order. Raises AcrcError for a damaged one."""
        for trial in self.study.trials():
            if self.path(trial).exists():
                yield self.record(trial)

    def record(self, trial: Trial) -> TrialRecord:
        """Of a trial that has ended. Raises AcrcError for a damaged one."""
        return typed_json.read(self.path(trial), TrialRecord, "record of a trial")


def create(folder: Path, study: Study) -> Store:
    """The store in a new folder, or the one that this study, or the same with fewer seeds, has begun there.

    Raises AcrcError if the folder holds something else, or what other software has begun, and SealError
    if it is not as it was left.
    """
    store, about = Store(folder, study), About(software_version())
    if store.study_file.exists():
        before = typed_json.read(store.study_file, Study, "study of a campaign")
        if study.seeds < before.seeds:
            raise AcrcError(
                f"{folder}: has {before.seeds} seeds, more than {study.seeds}; must be as many, or more"
            )
        if others := differences(before, study).keys() - {"seeds"}:
            raise AcrcError(
                f"{folder}: holds the campaign of another study ({min(others)} differs); "
                "must be new, or that of this one"
            )
        commit = store.commit
        if commit != about.commit:
            raise AcrcError(
                f"{folder}: was begun with {commit}, this is {about.commit}; their results do not compare"
            )
        check_seal(folder)
        (folder / SUMS).unlink(missing_ok=True)  # what it covers is about to change
        _check_parts(folder)
        keep(store.study_file, study)  # with more seeds it goes on
        return store
    if folder.exists() and {path.name for path in folder.iterdir()} - _OWN:
        raise AcrcError(f"{folder}: holds something that is no campaign; must be new or empty")
    folder.mkdir(parents=True, exist_ok=True)
    _check_parts(folder)
    keep(folder / _ABOUT, about)
    keep(store.study_file, study)
    return store


def _check_parts(folder: Path) -> None:
    """Make what is missing. Raises AcrcError for a link in its place."""
    for part in (_TRIALS, _CHECKS, _LOGS):
        try:
            regular_file.check_no_link(folder / part).mkdir(exist_ok=True)
        except OSError as error:
            raise AcrcError(f"{folder / part}: {error.strerror}") from None


def holds(folder: Path) -> bool:
    """True if a campaign has been begun in the folder."""
    return (folder / _STUDY).exists()


def load(folder: Path) -> Store:
    """The store in a folder. Raises AcrcError if there is none, SealError if it is not as it was left."""
    if not holds(folder):
        raise AcrcError(f"{folder}: holds no campaign; must be a folder that acrc campaign has made")
    check_seal(folder)
    return Store(folder, typed_json.read(folder / _STUDY, Study, "study of a campaign"))


IN_MEMORY: Final = (
    "Made in memory: there a strategy can reach the world, the referee and its own result, so this is for "
    "strategies that you trust; `acrc campaign --isolate` makes every run as isolated processes."
)
ISOLATED: Final = (
    "Every run was made as isolated processes: no strategy could reach the world, the referee or its result."
)
_MOST_TOLD: Final = 3


def protection(kept: Store) -> list[str]:
    """What is protected in these runs and what is not, in sentences that come before all others."""
    results = [record.result for record in kept.records() if record.result is not None]
    other = [f"{line}." for line in other_software(kept)]
    if kept.study.isolated:
        open_ = sum(result.isolation != "full" for result in results)
        isolated = (
            f"{open_} of {len(results)} runs were NOT isolated, as the study wants." if open_ else ISOLATED
        )
        return [isolated, *other]
    return [IN_MEMORY, *_repeated(kept, results), *other]


def other_software(kept: Store) -> list[str]:
    """Which runs were made with software that was changed or committed after the campaign had begun."""
    made = [record.result.origin.commit for record in kept.records() if record.result is not None]
    others = [commit for commit in made if commit != kept.commit]
    if not others:
        return []
    return [
        f"{len(others)} of {len(made)} runs were made with other software than {kept.commit}, with which the "
        f"campaign began: {', '.join(dict.fromkeys(others))}"
    ]


def _repeated(kept: Store, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield how many runs were repeated as processes, how many of them isolated, and both speeds."""
    if not results:
        return
    checks = list(kept.checks())
    speed = f"{median(result.real_time_factor for result in results):.3g} x real time"
    if not checks:
        yield f"None of {len(results)} runs was repeated as processes; in memory {speed} (median)."
        return
    isolated = sum(check.isolation == "full" for check in checks)
    speeds = [check.over_zenoh_speed for check in checks if check.over_zenoh_speed is not None]
    over = f", as processes {median(speeds):.3g} x" if speeds else ""
    same = sum(check.agrees for check in checks)
    yield (
        f"{len(checks)} of {len(results)} runs were repeated as processes ({isolated} isolated): "
        f"{same} gave the same result; in memory {speed} (median){over}."
    )


def differing(kept: Store) -> list[str]:
    """Return a sentence for each run whose repetition had another result."""
    return [_difference(check) for check in kept.checks() if not check.agrees]


def _difference(check: CheckRecord) -> str:
    run = f"{check.strategy} with seed {check.seed}"
    if check.failure is not None:
        return f"{run} came to its end in memory, but not over Zenoh: {check.failure}"
    what = f"digest {check.in_memory} in memory, {check.over_zenoh} there"
    if check.in_memory == check.over_zenoh:
        what = "; ".join(check.differs[:_MOST_TOLD])
        what += f"; and {len(check.differs) - _MOST_TOLD} more" if len(check.differs) > _MOST_TOLD else ""
    return (
        f"{run} is another run over Zenoh than in memory: {what}; nothing that this campaign shows can be "
        "trusted before it is known why"
    )


_MOST_NAMED: Final = 3
NOTHING_FROZEN: Final = "Nothing was frozen before."
_FROZEN: Final = "Frozen before the first run,"
_ALL_ELSE: Final = "Whatever else is compared was not declared, and is exploration."


def plan_of(given: Path | None, study_file: Path | None) -> Path | None:
    """The file of the plan: what is given, or what lies beside the study's file; None if there is none.

    Raises AcrcError for a plan that is not as it was frozen.
    """
    beside = study_file.with_suffix(SUFFIX) if study_file is not None else None
    path = given or (beside if beside is not None and beside.exists() else None)
    if path is not None:
        frozen_plan.read(path)
    return path


def take_in(kept: Store, given: Path | None, study_file: Path | None, *, looks: bool) -> list[str]:
    """Keep a plan in a campaign that has no run yet, and hold the campaign against the plan that it has.

    Gives what is to be said before its next run. Raises AcrcError for a plan that is not as it was frozen, or
    that another campaign has.
    """
    if given is not None:
        plan, known = frozen_plan.read(given), kept.about().plan_sha256
        if known is not None and known != plan.sha256:
            raise AcrcError(
                f"{kept.folder}: was begun with the plan {known}, {given} is {plan.sha256}; "
                "must be that one, or another campaign"
            )
        if known is None:
            if any(kept.path(trial).exists() for trial in kept.study.trials()):
                return [f"{given}: is not taken, as {kept.folder} had runs before it had a plan."]
            keep_bytes(kept.plan_file, regular_file.read_bytes(given))
            keep(kept.about_file, msgspec.structs.replace(kept.about(), plan_sha256=plan.sha256))
    mine = kept.plan
    if mine is None:
        return []
    about = kept.about()
    found = dict.fromkeys((*about.departures, *_now(mine, kept, study_file)))
    keep(kept.about_file, msgspec.structs.replace(about, departures=tuple(found)))
    return [f"{_FROZEN} {declared(mine)}", *(_not(line) for line in departures(kept, mine, looks=looks))]


def plan_sentences(kept: Store) -> list[str]:
    """What was declared before the first run and what was not, a sentence each."""
    plan = kept.plan
    if plan is None:
        return [NOTHING_FROZEN]
    found = list(departures(kept, plan, looks=kept.looks is not None))
    left = len(kept.pending())
    if left and not plan.looks:
        found.append(f"{left} of {sum(1 for _ in kept.study.trials())} runs are still to be made")
    return [
        f"{_FROZEN} {declared(plan)}",
        *(map(_not, found) if found else ["The campaign is as frozen."]),
        _ALL_ELSE,
    ]


def declared(plan: FrozenPlan) -> str:
    """What a plan says, as it goes on after a word such as "Frozen"."""
    study = plan.study
    pairs = " and ".join(f"{one} against {other}" for one, other in study.primary_pairs) or "no comparison"
    margins = f"of {study.margin_places:g} in places and {study.margin_s:g} s"
    return (
        f"at commit {plan.commit}, SHA-256 {plan.sha256}: {pairs} by {study.primary_metric}, "
        f"margins {margins}, {study.seeds} seeds, {_looks(plan) if plan.looks else 'no look on the way'}."
    )


def departures(kept: Store, plan: FrozenPlan, *, looks: bool) -> Iterator[str]:
    """What a campaign has otherwise than its plan."""
    yield from frozen_plan.departures(plan, kept.study)
    if looks and not plan.looks:
        yield "it is looked at on the way, and no look was planned"
    if plan.looks and not looks:
        yield f"it is not looked at on the way, and {_looks(plan)} were planned"
    yield from kept.about().departures
    yield from other_software(kept)


def _looks(plan: FrozenPlan) -> str:
    return f"looks after {', '.join(map(str, plan.looks))} pairs"


def _now(plan: FrozenPlan, kept: Store, study_file: Path | None) -> Iterator[str]:
    """What files and software have otherwise at this moment."""
    yield from frozen_plan.changed_files(plan, kept.study)
    here = software_version()
    if here == plan.commit:
        return
    changed = changed_since(plan.commit)
    if changed is None:
        yield f"it was made with {here}, of which nothing shows that it descends from the frozen commit"
        return
    told = {realpath(path) for path in (*inputs(kept.study).files.values(), study_file) if path is not None}
    others = [path for path in changed if realpath(path) not in told and not path.name.endswith(SUFFIX)]
    if others:
        more = ", …" if others[_MOST_NAMED:] else ""
        yield (
            f"it was made with {here}, which descends from the frozen commit, but {len(others)} files differ "
            f"({', '.join(path.name for path in others[:_MOST_NAMED])}{more})"
        )


def _not(line: str) -> str:
    return f"Not as frozen: {line}."
