"""What people read of a bundle: the README in the form of an artifact appendix, and how it is to be cited."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from string import Template
from typing import Final

from experiments.campaign.trial_record import TrialRecord
from experiments.study.frozen_plan import FrozenPlan
from experiments.study.study import Study

CHAPTER: Final = "Experimenting with Adaptation in Smart Cyber-Physical Systems: A Model Problem and Testbed"
_CLEAN: Final = "It is in `software.zip`."
_CHANGED: Final = (
    "It is **not** in this bundle, for it had been changed since that commit, or is no longer in the "
    "repository: the digests may not come out again."
)
_PLANNED: Final = Template(
    "`study.frozen.json`, frozen at commit `$commit`, with SHA-256 `$sha256`. The hash shows that it is the "
    "plan that was published with it, and no date. What is not as frozen stands below."
)
_UNPLANNED: Final = "nothing was frozen before the first run."
_README: Final = Template("""# Artifact: $name

Results of the study `$name`, with all that is needed to check them and to make them again. The sections are
those of an artifact appendix as evaluation committees of ACM conferences ask for.

## Abstract

$abstract

## Check-list

- **Plan:** $plan
- **Program:** the ACRC testbed, commit `$commit`. $software
- **Run-time environment:** Linux (x86-64 or ARM) or macOS (ARM) with Python 3.11 or newer and its module
  `venv`. All packages are pinned with their hashes in `constraints.txt`; the runs were made with $versions.
- **Hardware:** any computer; 2 GB of memory for each run at a time. Digests are the same on every processor.
- **Data:** `inputs/`: scenario and maps. Everything random follows from the seeds in `study.json`.
- **Output:** a JSON record for each run, with its digest; `digests.csv` lists them.
- **Experiments:** $runs runs, $failed of which failed.
- **Disk space:** 2 GB with the environment.
- **Time:** a few minutes to prepare; the runs took $span of one core.
- **Licence:** of the software, Apache-2.0 (in its sources); of the results, what their authors say.

## What lies here

| | |
|---|---|
| `study.json` | what was asked: strategies, seeds, settings, declared comparisons |
| `study.frozen.json` | the plan, if one was frozen; `acrc campaign study.json` holds itself against it |
| `inputs/` | the scenario, and every file that it names |
| `results/` | the campaign's folder: `acrc compare results` and `acrc report results` read it |
| `report/` | the report on it: `report.html`, pictures, tables |
| `digests.csv` | what each run must come out as |
| `constraints.txt` | every package, at its version, with the hashes of its files |
| `reproduce.sh`, `check_digests.py` | make the runs again, and compare |
| `SHA256SUMS` | of all files: `sha256sum -c SHA256SUMS`, or `shasum -a 256 -c SHA256SUMS` |

## Installation and workflow

```sh
sha256sum -c SHA256SUMS   # nothing was changed on the way
./reproduce.sh 1          # the first seed of every strategy and variant: a smoke test
./reproduce.sh            # everything; goes on where it was interrupted
```

## Evaluation and expected result

Every run that is made again must have the digest and the places that it had; `reproduce.sh` says so, and ends
with exit code 0. What the results show, by `acrc compare results`:

$found

## Customization

`acrc campaign study.json --seeds N` runs more seeds, `--set KEY=VALUE` other conditions; strategies of your
own are compared with `acrc campaign --scenario inputs/$scenario --strategies
$strategies,your_module:your_strategy`.
""")


@dataclass(frozen=True)
class BundleFacts:
    """What the papers say about a campaign."""

    study: Study
    scenario: str
    """Its path among the inputs."""
    commit: str
    has_software: bool
    records: Sequence[TrialRecord]
    found: Sequence[str]
    """Sentences."""
    authors: Sequence[str]
    plan: FrozenPlan | None = None


def readme(about: BundleFacts) -> str:
    """README.md."""
    study = about.study
    results = [record.result for record in about.records if record.result is not None]
    versions = dict(pair for one in results for pair in one.origin.versions.items())
    names = ", ".join(f"`{name}`" for name in study.strategies)
    return _README.substitute(
        name=study.name,
        plan=_UNPLANNED
        if about.plan is None
        else _PLANNED.substitute(commit=about.plan.commit, sha256=about.plan.sha256),
        abstract=f"{names}, each with the same {study.seeds} seeds in {_conditions(study)}.",
        commit=about.commit,
        software=_CLEAN if about.has_software else _CHANGED,
        versions=", ".join(f"{name} {version}" for name, version in versions.items()) or "unknown versions",
        runs=len(about.records),
        failed=len(about.records) - len(results),
        span=_span(sum(one.cpu_s for one in results)),
        found="\n\n".join(about.found),
        scenario=about.scenario,
        strategies=",".join(study.strategies),
    )


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 300 else f"{seconds / 60:.0f} min"


def _conditions(study: Study) -> str:
    count = len(study.variants())
    return "one condition" if count == 1 else f"{count} conditions"


def citation(about: BundleFacts) -> str:
    """CITATION.cff (Citation File Format 1.2.0); its texts are written as JSON, which is YAML."""
    title = f"Results of the study {about.study.name} with the ACRC testbed"
    authors = "".join(f"  - name: {json.dumps(name)}\n" for name in about.authors)
    return (
        "cff-version: 1.2.0\n"
        "type: dataset\n"
        "message: If you use these results, please cite them as below.\n"
        f"title: {json.dumps(title)}\n"
        f"authors:\n{authors}"
        f"commit: {json.dumps(about.commit)}\n"
        "references:\n"
        "  - type: book\n"
        f"    title: {json.dumps(CHAPTER)}\n"
        "    year: 2016\n"
        "    authors:\n"
        '      - name: "The authors of the model problem and testbed"\n'
    )
