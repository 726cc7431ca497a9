"""Bundle of a campaign: results, inputs, software, README and citation in one ZIP file."""

import csv
import hashlib
import io
import json
import subprocess
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Final

import msgspec

from acrc_testbed.experiments import store
from acrc_testbed.experiments.frozen_plan import SUFFIX, FrozenPlan, inputs
from acrc_testbed.experiments.judgement import judge
from acrc_testbed.experiments.report import report
from acrc_testbed.experiments.study import Study
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.results.seal import SUMS, lines
from actors.installation.repository import IS_CLONE, REPOSITORY, SHIPPED
from actors.processes.launcher import scratch_folder
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError

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


UNNAMED: Final = "Unnamed; write the authors here"
_HERE: Final = Path(__file__).parent
_INPUTS: Final = "inputs"


def make(folder: Path, out: Path, authors: Sequence[str] = ()) -> bool:
    """Bundle the campaign in `folder` into the ZIP file `out`; the same campaign gives the same bytes.

    True if the software that made the runs is in it: it is not where it had been changed since its commit.
    Raises AcrcError for a folder that holds no campaign or a damaged one.
    """
    kept = store.load(folder)
    records = list(kept.records())
    if not records:
        raise AcrcError(f"{folder}: no run of it has ended; must hold results to be bundled")
    read = inputs(kept.study)
    commit = kept.about().commit
    software = _software(commit)
    study = msgspec.structs.replace(kept.study, scenario=f"{_INPUTS}/{read.scenario}")
    there = msgspec.structs.replace(kept.study, scenario=f"../{_INPUTS}/{read.scenario}")
    about = BundleFacts(
        study=study,
        scenario=read.scenario,
        commit=commit,
        has_software=software is not None,
        records=records,
        found=_found(kept),
        authors=authors or [UNNAMED],
        plan=kept.plan,
    )
    files = {
        "README.md": readme(about).encode(),
        "CITATION.cff": citation(about).encode(),
        "study.json": typed_json.dump(study),
        "results/study.json": msgspec.json.encode(there),
        "digests.csv": _digests(records),
        "constraints.txt": (SHIPPED / "constraints.txt").read_bytes(),
        **{name: (_HERE / name).read_bytes() for name in ("reproduce.sh", "check_digests.py")},
        **{f"{_INPUTS}/{name}": regular_file.read_bytes(path) for name, path in read.files.items()},
        **dict(_plan(kept)),
        **dict(_results(kept)),
        **dict(_report(folder)),
    }
    if software is not None:
        files["software.zip"] = software
        pins = _committed(commit, "show", f"{commit}:constraints.txt")
        files["constraints.txt"] = pins or files["constraints.txt"]
    write_archive(out, folder.resolve().name, files)
    return software is not None


def _plan(kept: store.Store) -> Iterator[tuple[str, bytes]]:
    """Beside the study, where whoever makes the runs again finds it."""
    if kept.plan is not None:
        yield f"study{SUFFIX}", regular_file.read_bytes(kept.plan_file)


def _results(kept: store.Store) -> Iterator[tuple[str, bytes]]:
    trials = list(kept.study.trials())
    records = (part(trial) for part in (kept.path, kept.check_path) for trial in trials)
    for path in (kept.about_file, kept.plan_file, kept.looks_file, *records):
        if path.exists():
            yield f"results/{path.relative_to(kept.folder).as_posix()}", regular_file.read_bytes(path)


def _report(folder: Path) -> Iterator[tuple[str, bytes]]:
    with scratch_folder() as made:
        report.write([folder], made)
        for path in sorted(made.iterdir()):
            yield f"report/{path.name}", path.read_bytes()


def _found(kept: store.Store) -> list[str]:
    return judge(kept).sentences() or ["There is one strategy, so nothing was compared."]


def _digests(records: Sequence[TrialRecord]) -> bytes:
    into = io.StringIO()
    writer = csv.writer(into, lineterminator="\n")
    writer.writerow(("strategy", "seed", "variant", "digest"))
    for record in records:
        variant = ", ".join(f"{key} = {value}" for key, value in record.variant.items())
        digest = record.result.digest if record.result is not None else "failed"
        writer.writerow((record.strategy, record.seed, variant, digest))
    return into.getvalue().encode()


def _software(commit: str) -> bytes | None:
    """The sources of the commit as a ZIP file; None where they are not to be had as they were."""
    return None if commit.endswith("+") else _committed(commit, "archive", "--format=zip", commit)


def _committed(commit: str, *words: str) -> bytes | None:
    if not IS_CLONE:
        return None
    try:
        asked = ["git", "-C", str(REPOSITORY), *words]
        return subprocess.run(asked, check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None


_BEGIN: Final = (1980, 1, 1, 0, 0, 0)
"""The earliest instant that the format knows."""
_UNIX: Final = 3


def write_archive(path: Path, top: str, files: Mapping[str, bytes]) -> None:
    """Write the files into folder `top` of a new archive, with the SHA-256 sums of all in SUMS.

    What ends in `.sh` can be executed. The file is there whole or not at all.
    """
    sums = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    whole = {**files, SUMS: lines(sums)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with regular_file.atomic_replacement(path) as new, zipfile.ZipFile(new, "w") as archive:
        for name in sorted(whole):
            info = zipfile.ZipInfo(f"{top}/{name}", _BEGIN)
            info.create_system = _UNIX
            info.external_attr = (0o100755 if name.endswith(".sh") else 0o100644) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, whole[name], compresslevel=9)
