"""Live view of a run in progress, for `--view`: `python -m acrc_testbed.view --out FOLDER`."""

import os
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

from acrc_testbed.results.summary import LIVE_VIEW
from acrc_testbed.view import run_view
from acrc_testbed.view.run_view import FILE_NAME, print_now
from actors.observer import viewer
from actors.runtime.errors import AcrcError
from actors.runtime.linux import die_with_parent, exit_on_sigterm

_NICE = 10
"""Niceness, so that the run has priority."""


def main(argv: Sequence[str]) -> int:
    """Show a run until it ends, and write FOLDER/view.rrd; return the exit code."""
    exit_on_sigterm()
    parser = ArgumentParser(prog="python -m acrc_testbed.view")
    parser.add_argument("--out", type=Path, required=True, help="read the run in this folder")
    parser.add_argument("--robot", action="append", default=[], help="draw this robot in detail")
    options = parser.parse_args(argv)
    die_with_parent(os.getppid())
    os.nice(_NICE)
    path = options.out / FILE_NAME
    opened = viewer.open_any(print_now, f"the view is written to {path} only")
    try:
        if opened is not None and opened.page:
            print_now(f"{LIVE_VIEW}, open {opened.page} in a browser on this machine.")
        run_view.follow_run(options.out, path, options.robot, opened, print_now)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    finally:
        viewer.terminate(opened)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
