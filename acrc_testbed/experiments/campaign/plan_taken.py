"""The frozen plan of a campaign: taken in before its first run has ended, and held against what was done."""

from collections.abc import Iterator
from os.path import realpath
from pathlib import Path
from typing import Final

import msgspec

from acrc_testbed.experiments.campaign.store import Store, other_software
from acrc_testbed.experiments.campaign.trial_record import keep, keep_bytes
from acrc_testbed.experiments.study import frozen_plan
from acrc_testbed.experiments.study.frozen_plan import SUFFIX, FrozenPlan, inputs
from actors.installation.version import changed_since, software
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError

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
            keep_bytes(kept.plan_file, regular_file.content(given))
            keep(kept.about_file, msgspec.structs.replace(kept.about(), plan_sha256=plan.sha256))
    mine = kept.plan
    if mine is None:
        return []
    about = kept.about()
    found = dict.fromkeys((*about.departures, *_now(mine, kept, study_file)))
    keep(kept.about_file, msgspec.structs.replace(about, departures=tuple(found)))
    return [f"{_FROZEN} {declared(mine)}", *(_not(line) for line in departures(kept, mine, looks=looks))]


def told(kept: Store) -> list[str]:
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
    here = software()
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
