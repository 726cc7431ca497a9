"""Bundle of a campaign: results, inputs, software, README and citation in one ZIP file."""

import hashlib
import json
import subprocess
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Final

import msgspec

from acrc_testbed.experiments.evaluation import evaluate
from acrc_testbed.experiments.frozen_plan import SUFFIX, study_inputs
from acrc_testbed.experiments.report import report_page
from acrc_testbed.experiments.store import Store, load_store
from acrc_testbed.experiments.study import variant_text
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.results.outcome import csv_text
from acrc_testbed.results.seal import SUMS, checksum_lines
from actors.installation.repository import IS_CLONE, REPOSITORY, SHIPPED
from actors.processes.launcher import scratch_folder
from actors.runtime import regular_file, typed_json
from actors.runtime.errors import AcrcError

CHAPTER: Final = "Experimenting with Adaptation in Smart Cyber-Physical Systems: A Model Problem and Testbed"
_SOFTWARE_INCLUDED: Final = "Its sources are in `software.zip`."
_SOFTWARE_MISSING: Final = (
    "It is **not** in this bundle, because it had uncommitted changes or the commit is no longer in the "
    "repository; digests may differ when runs are repeated."
)
_PLANNED: Final = Template(
    "`study.frozen.json`, commit `$commit`, SHA-256 `$sha256`. The hash identifies the published plan but "
    "proves no date. Deviations are listed below."
)
_UNPLANNED: Final = "no plan was frozen before the first run."
_README: Final = Template("""# Artifact: $name

Results of the study `$name`, with everything needed to check and reproduce them. The sections follow the
artifact appendix of ACM conferences.

## Abstract

$abstract

## Check-list

- **Plan:** $plan
- **Program:** the ACRC testbed, commit `$commit`. $software
- **Run-time environment:** Linux (x86-64 or ARM) or macOS (ARM) with Python 3.11 or newer and its module
  `venv`. All packages are pinned with their hashes in `constraints.txt`; the runs used $versions.
- **Hardware:** any computer; 2 GB of memory per concurrent run. Digests do not depend on the processor.
- **Data:** `inputs/`: scenario and maps. All random numbers follow from the seeds in `study.json`.
- **Output:** a JSON record of each run with its digest; `digests.csv` lists all digests.
- **Experiments:** $runs runs, of which $failed failed.
- **Disk space:** 2 GB, including the environment.
- **Time:** a few minutes of installation; the runs took $span of CPU time.
- **Licence:** software: Apache-2.0 (in its sources); results: as stated by their authors.

## Content

| | |
|---|---|
| `study.json` | study: strategies, seeds, settings, declared comparisons |
| `study.frozen.json` | the frozen plan, if any; `acrc campaign study.json` reports deviations from it |
| `inputs/` | the scenario and all files that it refers to |
| `results/` | the campaign's folder, for `acrc compare results` and `acrc report results` |
| `report/` | the report: `report.html`, pictures, tables |
| `digests.csv` | expected digest of each run |
| `constraints.txt` | versions and hashes of all packages |
| `reproduce.sh`, `check_digests.py` | repeat the runs and compare |
| `SHA256SUMS` | checksums for `sha256sum -c SHA256SUMS` or `shasum -a 256 -c SHA256SUMS` |

## Installation and workflow

```sh
sha256sum -c SHA256SUMS   # check that all files are intact
./reproduce.sh 1          # smoke test: the first seed of every strategy and variant
./reproduce.sh            # all runs; resumes after an interruption
```

## Evaluation and expected result

Every repeated run must have the same digest and results; `reproduce.sh` compares them and then exits with
code 0. Results, by `acrc compare results`:

$found

## Customization

`acrc campaign study.json --seeds N` runs more seeds, `--set KEY=VALUE` changes conditions. Compare your own
strategy with `acrc campaign --scenario inputs/$scenario --strategies
$strategies,your_module:your_strategy`.
""")


def readme(store: Store, records: Sequence[TrialRecord], scenario: str, *, has_software: bool) -> str:
    """Return README.md; `scenario`: path of the scenario below inputs/."""
    study, plan = store.study, store.plan
    results = [record.result for record in records if record.result is not None]
    seconds = sum(one.cpu_s for one in results)
    sentences = evaluate(store).sentences() or ["There is only one strategy, so nothing was compared."]
    versions = dict(pair for one in results for pair in one.origin.versions.items())
    names = ", ".join(f"`{name}`" for name in study.strategies)
    count = len(study.variants())
    conditions = "one condition" if count == 1 else f"{count} conditions"
    return _README.substitute(
        name=study.name,
        plan=_UNPLANNED if plan is None else _PLANNED.substitute(commit=plan.commit, sha256=plan.sha256),
        abstract=f"{names}, each with the same {study.seeds} seeds in {conditions}.",
        commit=store.commit,
        software=_SOFTWARE_INCLUDED if has_software else _SOFTWARE_MISSING,
        versions=", ".join(f"{name} {version}" for name, version in versions.items()) or "unknown versions",
        runs=len(records),
        failed=len(records) - len(results),
        span=f"{seconds:.0f} s" if seconds < 300 else f"{seconds / 60:.0f} min",
        found="\n\n".join(sentences),
        scenario=scenario,
        strategies=",".join(study.strategies),
    )


def citation(store: Store, names: Sequence[str]) -> str:
    """Return CITATION.cff (Citation File Format 1.2.0); JSON strings are valid YAML."""
    title = f"Results of the study {store.study.name} with the ACRC testbed"
    authors = "".join(f"  - name: {json.dumps(name)}\n" for name in names)
    return (
        "cff-version: 1.2.0\n"
        "type: dataset\n"
        "message: If you use these results, please cite them as below.\n"
        f"title: {json.dumps(title)}\n"
        f"authors:\n{authors}"
        f"commit: {json.dumps(store.commit)}\n"
        "references:\n"
        "  - type: book\n"
        f"    title: {json.dumps(CHAPTER)}\n"
        "    year: 2016\n"
        "    authors:\n"
        '      - name: "The authors of the model problem and testbed"\n'
    )


_INPUTS: Final = "inputs"


def make_bundle(folder: Path, out: Path, authors: Sequence[str] = ()) -> bool:
    """Bundle the campaign in `folder` into the ZIP file `out`, reproducibly.

    Returns whether the sources are included; they are not if they had uncommitted changes. Raises AcrcError
    for a folder without a campaign, or a damaged one.
    """
    store = load_store(folder)
    records = list(store.records())
    if not records:
        raise AcrcError(f"{folder}: no run has ended, so there are no results to bundle")
    inputs = study_inputs(store.study)
    commit = store.commit
    software = None if commit.endswith("+") else _git_output("archive", "--format=zip", commit)
    study, results_study = (
        msgspec.structs.replace(
            store.study,
            scenario=f"{top}{inputs.scenario}",
            modules=inputs.modules and f"{top}{inputs.modules}",
        )
        for top in (f"{_INPUTS}/", f"../{_INPUTS}/")
    )
    files = {
        "README.md": readme(store, records, inputs.scenario, has_software=software is not None).encode(),
        "CITATION.cff": citation(store, authors or ["Unnamed; write the authors here"]).encode(),
        "study.json": typed_json.dump(study),
        "results/study.json": msgspec.json.encode(results_study),
        "digests.csv": _digest_table(records),
        "constraints.txt": (SHIPPED / "constraints.txt").read_bytes(),
        **{
            name: Path(__file__).with_name(name).read_bytes() for name in ("reproduce.sh", "check_digests.py")
        },
        **{f"{_INPUTS}/{name}": regular_file.read_bytes(path) for name, path in inputs.files.items()},
        **dict(_result_files(store)),
        **dict(_report_files(folder)),
    }
    if store.plan is not None:
        files[f"study{SUFFIX}"] = regular_file.read_bytes(store.plan_file)  # where `acrc campaign` finds it
    if software is not None:
        files["software.zip"] = software
        pins = _git_output("show", f"{commit}:constraints.txt")
        files["constraints.txt"] = pins or files["constraints.txt"]
    write_archive(out, folder.resolve().name, files)
    return software is not None


def _result_files(store: Store) -> Iterator[tuple[str, bytes]]:
    trials = list(store.study.trials())
    records = (path_of(trial) for path_of in (store.path, store.check_path) for trial in trials)
    for path in (store.info_file, store.plan_file, store.looks_file, *records):
        if path.exists():
            yield (
                f"results/{path.relative_to(store.folder).as_posix()}",
                regular_file.read_bytes(path),
            )


def _report_files(folder: Path) -> Iterator[tuple[str, bytes]]:
    with scratch_folder() as scratch:
        report_page.write([folder], scratch)
        for path in sorted(scratch.iterdir()):
            yield f"report/{path.name}", path.read_bytes()


def _digest_table(records: Sequence[TrialRecord]) -> bytes:
    rows: list[tuple[object, ...]] = [("strategy", "seed", "variant", "digest")]
    for record in records:
        digest = record.result.digest if record.result is not None else "failed"
        rows.append((record.strategy, record.seed, variant_text(record.variant.items()), digest))
    return csv_text(rows).encode()


def _git_output(*arguments: str) -> bytes | None:
    """Return the output of git; None without a clone, and for an unknown commit."""
    if not IS_CLONE:
        return None
    try:
        command = ["git", "-C", str(REPOSITORY), *arguments]
        return subprocess.run(command, check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return None


_EARLIEST_TIMESTAMP: Final = (1980, 1, 1, 0, 0, 0)
"""Earliest timestamp of the ZIP format."""
_UNIX_SYSTEM: Final = 3


def write_archive(path: Path, top: str, files: Mapping[str, bytes]) -> None:
    """Write files into folder `top` of a new archive, with their SHA-256 in SUMS; atomic.

    Files `*.sh` are executable.
    """
    sums = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    all_files = {**files, SUMS: checksum_lines(sums)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with regular_file.atomic_replacement(path) as new, zipfile.ZipFile(new, "w") as archive:
        for name in sorted(all_files):
            info = zipfile.ZipInfo(f"{top}/{name}", _EARLIEST_TIMESTAMP)
            info.create_system = _UNIX_SYSTEM
            info.external_attr = (0o100755 if name.endswith(".sh") else 0o100644) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, all_files[name], compresslevel=9)
