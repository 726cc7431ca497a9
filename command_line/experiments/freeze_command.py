"""`acrc study freeze`: the plan in a file, and what is published of it."""

from pathlib import Path

from actors.installation.version import software
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from command_line.options import answer
from deploy.run import out_folder
from experiments.campaign.plan_taken import declared
from experiments.comparison import decision
from experiments.comparison.family import step_names
from experiments.study import frozen_plan
from experiments.study.study_file import load_study


def run(study_file: Path, out: Path | None, *, until_decided: bool, json: bool) -> None:
    """Freeze the study beside its file, or where it is asked for. Raises AcrcError over a file."""
    target = out or study_file.with_suffix(frozen_plan.SUFFIX)
    if target.exists():
        raise AcrcError(f"{target}: is there already; must be another file, for what is frozen stays")
    study = load_study(study_file)
    step_names(study)
    looks = decision.rules_for(study).differ.looks if until_decided else ()
    content = frozen_plan.freeze(study, software(), looks)
    with out_folder.writing(target):
        regular_file.write(target, content)
    plan = frozen_plan.read(target)
    said = [
        f"Frozen {declared(plan)}",
        f"written to {target}; a hash proves no date: publish it before the first run to prove one",
    ]
    answer(said, {"file": target, "commit": plan.commit, "sha256": plan.sha256}, json=json)
