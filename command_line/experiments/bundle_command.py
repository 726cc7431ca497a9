"""`acrc bundle`: the file, and what is missing in it."""

from collections.abc import Sequence
from pathlib import Path

from command_line.options import answer
from deploy.run import out_folder
from experiments.bundle import bundle


def run(folder: Path, out: Path | None, authors: Sequence[str], *, json: bool) -> None:
    """Write the bundle beside the campaign's folder, or where it is asked for."""
    target = out or folder.resolve().parent / f"{folder.resolve().name}.zip"
    with out_folder.writing(target):
        has_software = bundle.make(folder, target, authors)
    said = [f"written to {target}; unpack it and call ./reproduce.sh to repeat the runs"]
    if not has_software:
        said.append("without the software: it was changed after its last commit, or that commit is gone")
    if not authors:
        said.append("its CITATION.cff names no author; give --author NAME")
    answer(said, {"file": target, "has_software": has_software, "authors": authors}, json=json)
