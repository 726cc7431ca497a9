"""`acrc report`: the page, and where it lies."""

from collections.abc import Sequence
from pathlib import Path

from actors.runtime import regular_file
from command_line.options import answer
from deploy.run import out_folder
from experiments.report import report


def run(folders: Sequence[Path], out: Path | None, *, json: bool) -> None:
    """Write the report beside the first folder's content, or where it is asked for."""
    target = out or folders[0] / "report"
    with out_folder.writing(target):
        page = report.write(folders, out or regular_file.no_link(target))
    said = f"written to {page}, with its pictures and tables beside it"
    answer([said], {"page": page}, json=json)
