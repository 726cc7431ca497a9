"""Imports of commands, in the process that `tests.warm` forks; not Dask, which reads its configuration."""

import tempfile
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from actors.installation import version
from actors.installation.repository import REPOSITORY
from actors.runtime.isolation import sandbox

LATER = (
    *(
        "acrc_testbed.benchmarks.",
        "acrc_testbed.experiments.",
        "acrc_testbed.command_line.campaign_commands.",
    ),
    "deploy.hosts.",
) + (() if find_spec("rerun") else ("deploy.fleet.fleet_view", "acrc_testbed.view."))

import_module("actors.processes.preload")
for _package in ("acrc_testbed", "cleaning", "deploy", "logistics"):
    for _file in sorted(Path(REPOSITORY, _package).rglob("*.py")):
        _name = ".".join(_file.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")
        if not _name.endswith("__main__") and not f"{_name}.".startswith(LATER):
            import_module(_name)
for _module in import_module("actors.processes.kernel_compilation").kernel_modules():
    _module.fingerprint()  # loads the kernels
version.software_version()  # this and the next call start two processes each, once for all forks
sandbox.isolation_fault()
tempfile.tempdir = None  # each fork has its own TMPDIR
import_module("actors.runtime.process").freeze_heap()  # garbage collection would copy the shared pages
