"""Every command imports only packages of the base and of the extras that `./acrc` installs for it."""

import ast
import inspect
import json
import subprocess
import sys
import textwrap
from collections import defaultdict

import pytest

from acrc_testbed.command_line.documentation import command_tree
from actors.installation.repository import REPOSITORY as ROOT
from tests.cli.test_acrc import extras_of

MODULES = {
    "cryptography": "hardware", "serial": "hardware", "pymunk": "sim",
    "rerun": "observe", "websockets": "control", "pyarrow": "observe experiments", "distributed": "cluster",
    "matplotlib": "pictures", "jinja2": "pictures cluster docs", "scipy": "experiments",
    "rosbags": "logs",
    "mpmath": "dev", "hypothesis": "dev", "pytest": "dev", "mypy": "dev", "psutil": "observe cluster dev",
    "sphinx": "docs", "docutils": "docs", "furo": "docs", "myst_parser": "docs",
}  # fmt: skip
"""Modules beyond the base, by the extras that install them."""
ACTORS = ("actors.world.__main__", "actors.radio.__main__", "actors.robot.__main__")
STARTED = {
    "run": ("deploy.run.swarm", "actors.processes.forkserver", *ACTORS),
    "run --view": ("acrc_testbed.view.__main__",),
    "run --control": ("deploy.control.__main__",),
    "run --hardware-in-the-loop": ("firmware_bridge.laboratory.__main__", "firmware_bridge.onboard.bridge"),
    "run --on x": ("deploy.hosts.allocation",),
    "fleet onboard": ("actors.robot.__main__", "firmware_bridge.onboard.base"),
    "campaign": ("acrc_testbed.experiments.trial_program",),
}
"""Modules of the processes that a command starts."""
IMPORTER = """
import importlib, json, sys
blocked, commands = json.loads(sys.argv[1])
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
import acrc_testbed.command_line.app
for command, modules in commands.items():
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            print(f"{command}: {module}: {error}")
"""


def imports_of(command: object) -> list[str]:
    function = inspect.unwrap(command.callback)  # type: ignore[attr-defined]
    nodes = ast.walk(ast.parse(textwrap.dedent(inspect.getsource(function))))
    names = [
        f"{node.module}.{one.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for one in node.names
    ]
    return [name if is_module(name) else name.rpartition(".")[0] for name in names]


def is_module(name: str) -> bool:
    path = ROOT / name.replace(".", "/")
    return path.is_dir() or path.with_suffix(".py").is_file()


def by_extras() -> dict[str, dict[str, list[str]]]:
    apart = {"acrc", "acrc test", "acrc check", "acrc add"}
    commands = {
        words.removeprefix("acrc "): imports_of(command)
        for words, command in command_tree().items()
        if words not in apart and not hasattr(command, "list_commands")
    }
    for words, modules in STARTED.items():
        commands[words] = [*commands.get(words, ()), *modules]
    groups: dict[str, dict[str, list[str]]] = defaultdict(dict)
    for words, extras in extras_of(commands).items():
        groups[extras][words] = commands[words]
    return groups


GROUPS = by_extras()
IN_SUITE = {"", "sim"}


@pytest.mark.parametrize(
    "extras",
    [pytest.param(name, marks=() if name in IN_SUITE else pytest.mark.nightly) for name in sorted(GROUPS)],
)
def test_a_command_imports_no_package_beyond_its_extras(extras: str) -> None:
    blocked = [module for module, extra in MODULES.items() if not {*extra.split()} & {*extras.split()}]
    done = subprocess.run(
        [sys.executable, "-P", "-c", IMPORTER, json.dumps([blocked, GROUPS[extras]])],
        cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    assert "run" in GROUPS["sim"] and "record info" in GROUPS[""]
