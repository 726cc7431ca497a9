"""A frozen plan: what a study is to show and by what rule, with the SHA-256 of all that it depends on.

The hash shows that a plan is the one that was hashed. It does not show when that was: who wants to prove it
publishes the hash before the first run.
"""

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError
from experiments.study.inputs import inputs
from experiments.study.study import Study, differences

SUFFIX: Final = ".frozen.json"
_APART: Final = frozenset({"name", "scenario", "seeds", "primary"})
"""Of a study: what may change, what its files say, and what is compared in words of its own."""
_LARGEST: Final = 1 << 20


class FrozenPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was declared before the first run."""

    commit: str
    """Of the software, without uncommitted changes."""
    study: Study
    """With all margins and declared comparisons; its scenario is named without folders."""
    files: tuple[tuple[str, str], ...]
    """Name, without folders, and SHA-256 of the scenario and of every file that it names."""
    looks: tuple[int, ...]
    """Stop rule: numbers of pairs at which the comparisons are looked at; empty: all seeds are run."""
    study_sha256: str
    """Of study and files: equal for equal studies at whatever commit."""
    sha256: str
    """Of all the above."""


def freeze(study: Study, commit: str, looks: Sequence[int]) -> bytes:
    """Return the plan of a study as a file. Raises AcrcError for changed software and missing files."""
    if commit.endswith("+"):
        raise AcrcError(
            f"the software was changed since its commit {commit[:-1]}; must be committed before a plan is "
            "frozen, so that others can get it"
        )
    told: dict[str, Any] = {
        "study": msgspec.to_builtins(msgspec.structs.replace(study, scenario=Path(study.scenario).name)),
        "files": _hashed(study),
    }
    told["study_sha256"] = _sha256(told)
    told |= {"commit": commit, "looks": list(looks)}
    return msgspec.json.format(msgspec.json.encode({**told, "sha256": _sha256(told)}, order="sorted")) + b"\n"


def read(path: Path) -> FrozenPlan:
    """The plan in a file. Raises AcrcError for none, and for one whose content is not what was hashed."""
    plan = typed_json.read(path, FrozenPlan, "frozen plan", _LARGEST)
    told = msgspec.json.decode(regular_file.content(path, _LARGEST))
    for name, over in (
        ("sha256", {key: value for key, value in told.items() if key != "sha256"}),
        ("study_sha256", {key: told[key] for key in ("study", "files")}),
    ):
        if (found := _sha256(over)) != told[name]:
            raise AcrcError(
                f"{path}: no frozen plan: was changed after it was frozen, as its {name} is {told[name]}, "
                f"but that of its content {found}"
            )
    return plan


def departures(plan: FrozenPlan, study: Study) -> Iterator[str]:
    """A sentence for each thing that a study has otherwise than in the plan, but for the files."""
    then = plan.study
    if study.seeds != then.seeds:
        yield f"seeds is {study.seeds}, frozen was {then.seeds}"
    for one, other in study.primary_pairs:
        if (one, other) not in then.primary_pairs:
            yield f"the comparison of {one} with {other} was not declared beforehand"
    for one, other in then.primary_pairs:
        if (one, other) not in study.primary_pairs:
            yield f"the comparison of {one} with {other} was declared beforehand, and is not any more"
    for field, (here, frozen) in differences(study, then).items():
        if field not in _APART:
            yield f"{field} is {here}, frozen was {frozen}"


def changed_files(plan: FrozenPlan, study: Study) -> Iterator[str]:
    """A sentence for each file that a study reads otherwise than in the plan. Raises AcrcError."""
    here, frozen = Counter(_hashed(study)), Counter(plan.files)
    names = dict.fromkeys(name for name, _ in (*(frozen - here), *(here - frozen)))
    for name in names:
        before, now = ({found for of, found in some if of == name} for some in (frozen, here))
        if not now:
            yield f"{name} is not read any more"
        elif not before:
            yield f"{name} was not read"
        else:
            yield f"{name} has another content"


def _hashed(study: Study) -> list[tuple[str, str]]:
    files = inputs(study).files.values()
    return sorted((path.name, hashlib.sha256(regular_file.content(path)).hexdigest()) for path in files)


def _sha256(told: Any) -> str:
    """Of the JSON with sorted keys and without spaces, in UTF-8."""
    return hashlib.sha256(msgspec.json.encode(told, order="sorted")).hexdigest()
