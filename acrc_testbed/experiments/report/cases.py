"""The runs that a report is about, from folders of campaigns and of single runs, real robots' too."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from acrc_testbed.accounting.time_spent import TimeSpent
from acrc_testbed.experiments.campaign import store
from acrc_testbed.experiments.campaign.store import differing, protection
from acrc_testbed.experiments.campaign.trial_record import TrialRecord
from acrc_testbed.experiments.comparison.judgement import CampaignJudgement, judge
from acrc_testbed.experiments.study.study import Study
from acrc_testbed.results.result import RunResult
from actors.runtime import typed_json
from actors.runtime.errors import AcrcError

REAL: Final = "real robots"
"""Condition of field trials."""
_RESULTS: Final = ("run.json", "result/run.json")
"""Where a run's result lies in its folder; the second is that of emulated devices."""


class Case(NamedTuple):
    """One run, or an attempt at one."""

    condition: str
    """What it shares with the runs beside which it may be set."""
    strategy: str
    seed: int | None
    outcome: RunResult | None
    failure: str | None = None
    """Why there is no outcome, one sentence."""
    time: TimeSpent | None = None


@dataclass(frozen=True)
class CaseSource:
    """One folder."""

    name: str
    study: Study | None
    """None: of a single run."""
    commit: str
    """Empty: unknown."""
    records: tuple[TrialRecord, ...]
    """Of a campaign."""
    pending: int
    """Trials of the campaign that have not ended."""
    cases: tuple[Case, ...]
    protection: tuple[str, ...] = ()
    """What is protected in a campaign's runs and what is not."""
    differing: tuple[str, ...] = ()
    """Which of its runs are not what they were as processes."""
    judgement: CampaignJudgement | None = None
    """Of a campaign."""


def read(folders: Sequence[Path]) -> tuple[CaseSource, ...]:
    """What lies in the folders, in their order. Raises AcrcError."""
    several = sum(map(store.holds, folders)) > 1
    named = zip(folders, _names(folders), strict=True)
    return tuple(
        _campaign(store.load(folder), name, several=several) if store.holds(folder) else _single(folder, name)
        for folder, name in named
    )


def _names(folders: Sequence[Path]) -> list[str]:
    """Each folder's own name, with a number where it is that of an earlier one, too."""
    found: list[str] = []
    for folder in folders:
        name = folder.resolve().name
        tries = (name if number == 1 else f"{name}-{number}" for number in itertools.count(1))
        found.append(next(one for one in tries if one not in found))
    return found


def _campaign(kept: store.Store, name: str, *, several: bool) -> CaseSource:
    records = tuple(kept.records())
    cases = []
    for record in records:
        variant = ", ".join(f"{key} = {value}" for key, value in record.variant.items())
        condition = ": ".join(part for part in (name if several else "", variant) if part) or kept.study.name
        cases.append(
            Case(condition, record.strategy, record.seed, record.result, record.failure, record.time)
        )
    return CaseSource(
        name=name,
        study=kept.study,
        commit=kept.about().commit,
        records=records,
        pending=len(kept.pending()),
        cases=tuple(cases),
        protection=tuple(protection(kept)),
        differing=tuple(differing(kept)),
        judgement=judge(kept),
    )


def _single(folder: Path, name: str) -> CaseSource:
    path = next((folder / one for one in _RESULTS if (folder / one).is_file()), None)
    if path is None:
        raise AcrcError(
            f"{folder}: holds neither a campaign nor the result of a run; must be a folder that "
            "acrc campaign, acrc run or acrc fleet collect has made"
        )
    outcome = typed_json.read(path, RunResult, "result of a run")
    if not outcome.is_simulated:
        return CaseSource(name, None, "", (), 0, (Case(REAL, name, None, outcome),))
    origin = outcome.origin
    condition = f"{origin.scenario or 'one scenario'}, {outcome.robots} robots, {outcome.simulated_s:g} s"
    case = Case(condition, origin.strategy or name, outcome.seed, outcome)
    return CaseSource(name, None, origin.commit, (), 0, (case,))
