"""Imports what commands need, in the process that `tests.warm` forks; Dask reads its configuration later."""

import tempfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from actors.installation import version
from actors.installation.repository import REPOSITORY
from actors.runtime.isolation import sandbox

LATER = (
    *("acrc_testbed.benchmarks.", "acrc_testbed.experiments.", "acrc_testbed.command_line.campaigns."),
    "deploy.hosts.",
) + (() if find_spec("rerun") else ("deploy.fleet.fleet_view", "acrc_testbed.view."))

import_module("actors.processes.preload")
for _package in ("acrc_testbed", "deploy"):
    for _file in sorted(Path(REPOSITORY, _package).rglob("*.py")):
        _name = ".".join(_file.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")
        if not _name.endswith("__main__") and not f"{_name}.".startswith(LATER):
            import_module(_name)
version.software()  # starts two processes, as does the next: once for all forks
sandbox.available()
tempfile.tempdir = None  # each fork has a TMPDIR of its own
import_module("actors.runtime.process").settle()  # no collection copies the shared pages
