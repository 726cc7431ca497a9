"""Folder of a campaign: its study, a record for each completed trial, and its frozen plan."""

from collections.abc import Iterator, Sequence
from os.path import realpath
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

import msgspec

from acrc_testbed.experiments import frozen_plan
from acrc_testbed.experiments.frozen_plan import SUFFIX, FrozenPlan, study_inputs
from acrc_testbed.experiments.study import Study, Trial, differences
from acrc_testbed.experiments.trial_record import CheckRecord, TrialRecord, write_durably, write_json
from acrc_testbed.results.result import RunResult
from acrc_testbed.results.seal import SUMS, check_seal
from actors.installation.version import changed_since, software_version
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError

_STUDY: Final = "study.json"
_INFO: Final = "campaign.json"
_TRIALS: Final = "trials"
_CHECKS: Final = "checks"
_LOGS: Final = "logs"
_PLAN: Final = "plan.json"
_INITIAL_ENTRIES: Final = frozenset({_INFO, _TRIALS, _CHECKS, _LOGS, _PLAN, "campaign.new", "study.new"})
"""Entries of the folder of a campaign whose creation was interrupted."""


class CampaignInfo(msgspec.Struct, frozen=True):
    """Properties of a campaign besides its study."""

    commit: str
    plan_sha256: str | None = None
    """SHA-256 of the plan frozen before the first run; None: no plan."""
    departures: tuple[str, ...] = ()
    """Deviations of software and files from the plan, over all starts of the campaign."""


class InterimLooks(msgspec.Struct, frozen=True):
    """Declaration of interim looks; permanent once made."""

    cap: int
    """Maximum number of pairs."""
    metric: str


class PendingTrial(NamedTuple):
    """A trial to run, or to repeat over Zenoh."""

    trial: Trial
    check: bool = False
    """True: repeat."""


class Store:
    """Storage of a campaign in its folder."""

    def __init__(self, folder: Path, study: Study) -> None:
        self.folder = folder
        self.study = study
        self.study_file = folder / _STUDY
        self.info_file = folder / _INFO
        self.plan_file = folder / _PLAN
        """File of the frozen plan; may not exist."""
        self.looks_file = folder / "looks.json"
        """File that declares interim looks; may not exist."""

    def info(self) -> CampaignInfo:
        """Read the properties besides the study. Raises AcrcError for a damaged file."""
        return typed_json.read(self.info_file, CampaignInfo, "campaign")

    def pending(self) -> list[PendingTrial]:
        """Return the trials without a record, in the study's order."""
        return [PendingTrial(trial) for trial in self.study.trials() if not self.path(trial).exists()]

    def unchecked_trials(self, every: int) -> list[PendingTrial]:
        """Return the first and every Nth trial of each strategy, if not repeated yet."""
        return [
            PendingTrial(trial, check=True)
            for strategy in self.study.strategies
            for trial in [one for one in self.study.trials() if one.strategy == strategy][::every]
            if self.path(trial).exists() and not self.check_path(trial).exists()
            if self.record(trial).result is not None
        ]

    def check_path(self, trial: Trial) -> Path:
        """Return the path of the record of a trial's repetition."""
        return self.folder / _CHECKS / f"{trial.name}.json"

    def checks(self) -> Iterator[CheckRecord]:
        """Yield the records of repeated trials, in the study's order. Raises AcrcError for a damaged one."""
        for trial in self.study.trials():
            if self.check_path(trial).exists():
                yield self.check(trial)

    def check(self, trial: Trial) -> CheckRecord:
        """Read the record of a repeated trial. Raises AcrcError for a damaged one."""
        return typed_json.read(self.check_path(trial), CheckRecord, "record of a repeated trial")

    def declare_looks(self) -> None:
        """Declare interim looks. Raises AcrcError if other looks were declared before."""
        here = InterimLooks(self.study.seeds, self.study.primary_metric)
        before = self.looks
        if before is not None and before != here:
            raise AcrcError(
                f"{self.folder}: has had interim looks for {before.cap} pairs by {before.metric}; {here.cap} "
                f"pairs by {here.metric} would change the error rate; keep the plan or use a new folder"
            )
        write_json(self.looks_file, here)

    @property
    def looks(self) -> InterimLooks | None:
        """Declared interim looks; None: none."""
        path = self.looks_file
        return typed_json.read(path, InterimLooks, "looks at a campaign") if path.exists() else None

    @property
    def commit(self) -> str:
        """Commit of the testbed at the start of the campaign."""
        return self.info().commit

    @property
    def plan(self) -> FrozenPlan | None:
        """Plan frozen before the first run; None: no plan. Raises AcrcError if it was replaced."""
        known = self.info().plan_sha256
        if known is None:
            return None
        plan = frozen_plan.read_plan(self.plan_file)
        if plan.sha256 != known:
            raise AcrcError(
                f"{self.plan_file}: SHA-256 is {plan.sha256}, but the campaign began with the plan {known}"
            )
        return plan

    def path(self, trial: Trial) -> Path:
        """Return the path of a trial's record."""
        return self.folder / _TRIALS / f"{trial.name}.json"

    def log(self, trial: Trial, *, check: bool) -> Path:
        """Return the path of the log of a trial's process, or of its repetition."""
        return self.folder / _LOGS / f"{trial.name}{'-check' if check else ''}.log"

    def records(self) -> Iterator[TrialRecord]:
        """Yield the records of ended trials, in the study's order. Raises AcrcError for a damaged one."""
        for trial in self.study.trials():
            if self.path(trial).exists():
                yield self.record(trial)

    def record(self, trial: Trial) -> TrialRecord:
        """Read the record of an ended trial. Raises AcrcError for a damaged one."""
        return typed_json.read(self.path(trial), TrialRecord, "record of a trial")


def create_store(folder: Path, study: Study) -> Store:
    """Create a campaign in a new folder, or reopen the campaign of the same study with as many or more seeds.

    Raises AcrcError if the folder has other content or another commit, SealError if its files were changed.
    """
    store, info = Store(folder, study), CampaignInfo(software_version())
    is_new = not store.study_file.exists()
    if not is_new:
        before = typed_json.read(store.study_file, Study, "study of a campaign")
        if study.seeds < before.seeds:
            raise AcrcError(
                f"{folder}: the campaign has {before.seeds} seeds; {study.seeds} must not be fewer"
            )
        if changed := {name: both for name, both in differences(before, study).items() if name != "seeds"}:
            name, (there, here) = min(changed.items())
            raise AcrcError(
                f"{folder.resolve()}: contains the campaign of another study, in which {name} is {there} and "
                f"not {here}; choose a new folder"
            )
        commit = store.commit
        if commit != info.commit:
            raise AcrcError(
                f"{folder}: campaign of commit {commit}; results of {info.commit} are not comparable"
            )
        check_seal(folder)
        (folder / SUMS).unlink(missing_ok=True)  # the sealed files are about to change
    elif folder.exists() and {path.name for path in folder.iterdir()} - _INITIAL_ENTRIES:
        raise AcrcError(f"{folder}: contains files that are not a campaign; choose a new or empty folder")
    folder.mkdir(parents=True, exist_ok=True)
    for part in (_TRIALS, _CHECKS, _LOGS):
        try:
            regular_file.check_no_link(folder / part).mkdir(exist_ok=True)
        except OSError as error:
            raise AcrcError(f"{folder / part}: {error.strerror}") from None
    if is_new:
        write_json(store.info_file, info)
    write_json(store.study_file, study)  # may have more seeds
    return store


def is_campaign(folder: Path) -> bool:
    """Return whether the folder contains a campaign."""
    return (folder / _STUDY).exists()


def load_store(folder: Path) -> Store:
    """Open the campaign in a folder. Raises AcrcError if there is none, SealError for changed files."""
    if not is_campaign(folder):
        raise AcrcError(f"{folder}: not a campaign; give a folder written by acrc campaign")
    check_seal(folder)
    return Store(folder, typed_json.read(folder / _STUDY, Study, "study of a campaign"))


IN_MEMORY: Final = (
    "Strategies shared a process with the simulation and could have changed its result; run strategies that "
    "you do not trust with `acrc campaign --isolate`."
)
ISOLATED: Final = "Every robot ran in a sandbox: no strategy had access to world, referee or result."
_MAX_DIFFERENCES: Final = 3


def isolation_sentences(store: Store) -> list[str]:
    """Return sentences on the isolation of strategies, to be shown first."""
    results = [record.result for record in store.records() if record.result is not None]
    other = [f"{line}." for line in commit_sentences(store)]
    if store.study.isolated:
        failed = sum(result.isolation != "full" for result in results)
        text = f"{failed} of {len(results)} runs were NOT isolated, as the study requires."
        return [text if failed else ISOLATED, *other]
    return [IN_MEMORY, *_repetition_sentences(store, results), *other]


def commit_sentences(store: Store) -> list[str]:
    """Return a sentence on runs made with another commit than the first; empty if none."""
    commits = [record.result.origin.commit for record in store.records() if record.result is not None]
    others = [commit for commit in commits if commit != store.commit]
    if not others:
        return []
    return [
        f"the campaign began with commit {store.commit}, but {len(others)} of {len(commits)} runs were made "
        f"with {', '.join(dict.fromkeys(others))}"
    ]


def _repetition_sentences(store: Store, results: Sequence[RunResult]) -> Iterator[str]:
    """Yield a sentence on runs repeated as processes, their isolation, and both speeds."""
    if not results:
        return
    checks = list(store.checks())
    speed = f"{median(result.real_time_factor for result in results):.3g} x real time"
    if not checks:
        yield f"None of {len(results)} runs was repeated as processes; speed in memory {speed} (median)."
        return
    isolated = sum(check.isolation == "full" for check in checks)
    speeds = [check.over_zenoh_speed for check in checks if check.over_zenoh_speed is not None]
    over = f", as processes {median(speeds):.3g} x" if speeds else ""
    same = sum(check.agrees for check in checks)
    yield (
        f"{len(checks)} of {len(results)} runs were repeated as processes ({isolated} with sandboxes): "
        f"{same} with the same result; speed in memory {speed} (median){over}."
    )


def difference_sentences(store: Store) -> list[str]:
    """Return a sentence for each run whose repetition has a different result."""
    return [_difference_sentence(check) for check in store.checks() if not check.agrees]


def _difference_sentence(check: CheckRecord) -> str:
    run = f"{check.strategy} with seed {check.seed}"
    if check.failure is not None:
        return f"{run} succeeded in memory but failed over Zenoh: {check.failure}"
    what = f"digest {check.in_memory} in memory, {check.over_zenoh} over Zenoh"
    if check.in_memory == check.over_zenoh:
        what = "; ".join(check.differs[:_MAX_DIFFERENCES])
        more = len(check.differs) - _MAX_DIFFERENCES
        what += f"; and {more} more" if more > 0 else ""
    return (
        f"{run} differs between Zenoh and memory: {what}; do not trust this campaign until the cause is known"
    )


_MAX_FILES: Final = 3
NO_FROZEN_PLAN: Final = "No plan was frozen before the first run."
_FROZEN: Final = "Frozen before the first run,"


def find_plan(plan_file: Path | None, study_file: Path | None) -> Path | None:
    """Return the file of the plan: `plan_file`, or the one beside the study's file; None: no plan.

    Raises AcrcError for a plan that was changed.
    """
    if plan_file is None and study_file is not None and study_file.with_suffix(SUFFIX).exists():
        plan_file = study_file.with_suffix(SUFFIX)
    if plan_file is not None:
        frozen_plan.read_plan(plan_file)
    return plan_file


def record_plan(store: Store, plan_file: Path | None, study_file: Path | None, *, looks: bool) -> list[str]:
    """Record a plan in a campaign without runs, and return sentences on deviations from the recorded plan.

    The sentences are printed before the next run. Raises AcrcError for a plan that was changed or differs
    from the campaign's plan.
    """
    if plan_file is not None:
        plan, known = frozen_plan.read_plan(plan_file), store.info().plan_sha256
        if known is not None and known != plan.sha256:
            raise AcrcError(
                f"{store.folder}: the campaign began with the plan {known}; {plan_file} is {plan.sha256}; "
                "use the same plan or a new folder"
            )
        if known is None:
            if any(store.path(trial).exists() for trial in store.study.trials()):
                return [f"{plan_file}: ignored, because {store.folder} has runs made without a plan."]
            write_durably(store.plan_file, regular_file.read_bytes(plan_file))
            write_json(store.info_file, msgspec.structs.replace(store.info(), plan_sha256=plan.sha256))
    recorded = store.plan
    if recorded is None:
        return []
    info = store.info()
    all_deviations = dict.fromkeys((*info.departures, *_current_deviations(recorded, store, study_file)))
    write_json(store.info_file, msgspec.structs.replace(info, departures=tuple(all_deviations)))
    return [
        f"{_FROZEN} {plan_text(recorded)}",
        *(_deviation_sentence(line) for line in deviations(store, recorded, looks=looks)),
    ]


def plan_sentences(store: Store) -> list[str]:
    """Return sentences on the frozen plan and deviations from it."""
    plan = store.plan
    if plan is None:
        return [NO_FROZEN_PLAN]
    all_deviations = list(deviations(store, plan, looks=store.looks is not None))
    left = len(store.pending())
    if left and not plan.looks:
        all_deviations.append(f"{left} of {sum(1 for _ in store.study.trials())} runs are missing")
    return [
        f"{_FROZEN} {plan_text(plan)}",
        *(map(_deviation_sentence, all_deviations) if all_deviations else ["The campaign follows the plan."]),
        "All other comparisons are exploratory.",
    ]


def plan_text(plan: FrozenPlan) -> str:
    """Return the content of a plan as the continuation of a sentence, such as after "Frozen"."""
    study = plan.study
    pairs = " and ".join(f"{one} versus {other}" for one, other in study.primary_pairs) or "no comparison"
    margins = " and ".join(
        f"{one.margin:g} {one.unit} in {one.description}"
        for one in study.step_metrics()
        if one.margin is not None
    )
    return (
        f"commit {plan.commit}, SHA-256 {plan.sha256}: {pairs} by {study.primary_metric}, "
        f"margins of {margins or 'none'}, {study.seeds} seeds, "
        f"{_looks_text(plan) if plan.looks else 'no interim looks'}."
    )


def deviations(store: Store, plan: FrozenPlan, *, looks: bool) -> Iterator[str]:
    """Yield deviations of a campaign from its plan."""
    yield from frozen_plan.deviations(plan, store.study)
    if looks and not plan.looks:
        yield "interim looks were made, but none were planned"
    if plan.looks and not looks:
        yield f"no interim looks were made, but {_looks_text(plan)} were planned"
    yield from store.info().departures
    yield from commit_sentences(store)


def _looks_text(plan: FrozenPlan) -> str:
    return f"interim looks after {', '.join(map(str, plan.looks))} pairs"


def _current_deviations(plan: FrozenPlan, store: Store, study_file: Path | None) -> Iterator[str]:
    """Yield current deviations of files and software from the plan."""
    yield from frozen_plan.changed_files(plan, store.study)
    here = software_version()
    if here == plan.commit:
        return
    changed = changed_since(plan.commit)
    if changed is None:
        yield f"it was made with commit {here}, which cannot be shown to descend from the planned one"
        return
    own = {
        realpath(path) for path in (*study_inputs(store.study).files.values(), study_file) if path is not None
    }
    others = [path for path in changed if realpath(path) not in own and not path.name.endswith(SUFFIX)]
    if others:
        more = ", …" if others[_MAX_FILES:] else ""
        yield (
            f"it was made with commit {here}, in which {len(others)} files differ from the planned one "
            f"({', '.join(path.name for path in others[:_MAX_FILES])}{more})"
        )


def _deviation_sentence(line: str) -> str:
    return f"Deviation from the plan: {line}."
