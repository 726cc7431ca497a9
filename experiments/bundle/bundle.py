"""Puts together the bundle of a campaign."""

import csv
import hashlib
import io
import subprocess
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec

from actors.installation.repository import IS_CLONE, REPOSITORY, SHIPPED
from actors.processes.scratch import scratch_folder
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from experiments.bundle.papers import BundleFacts, citation, readme
from experiments.campaign import store
from experiments.campaign.trial_record import TrialRecord
from experiments.comparison.judgement import judge
from experiments.report import report
from experiments.study.frozen_plan import SUFFIX
from experiments.study.inputs import inputs
from observation.results.seal import SUMS, lines

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
        "study.json": msgspec.json.format(msgspec.json.encode(study)) + b"\n",
        "results/study.json": msgspec.json.encode(there),
        "digests.csv": _digests(records),
        "constraints.txt": (SHIPPED / "constraints.txt").read_bytes(),
        **{name: (_HERE / name).read_bytes() for name in ("reproduce.sh", "check_digests.py")},
        **{f"{_INPUTS}/{name}": regular_file.content(path) for name, path in read.files.items()},
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
        yield f"study{SUFFIX}", regular_file.content(kept.plan_file)


def _results(kept: store.Store) -> Iterator[tuple[str, bytes]]:
    trials = list(kept.study.trials())
    records = (part(trial) for part in (kept.path, kept.check_path) for trial in trials)
    for path in (kept.about_file, kept.plan_file, kept.looks_file, *records):
        if path.exists():
            yield f"results/{path.relative_to(kept.folder).as_posix()}", regular_file.content(path)


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
    with regular_file.replaced(path) as new, zipfile.ZipFile(new, "w") as archive:
        for name in sorted(whole):
            info = zipfile.ZipInfo(f"{top}/{name}", _BEGIN)
            info.create_system = _UNIX
            info.external_attr = (0o100755 if name.endswith(".sh") else 0o100644) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, whole[name], compresslevel=9)
