"""Every command with the packages that `./acrc` installs for it; all others are not to be found."""

import ast
import json
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import typer

from benchmarks.claims.verification import CHECKED
from command_line.app import app
from command_line.bench.bench import BENCHMARKS
from command_line.lazy import COMMANDS

ROOT = Path(__file__).parents[2]
MODULES = {
    "cryptography": "hardware", "serial": "hardware", "pymunk": "sim",
    "rerun": "observe", "websockets": "control", "pyarrow": "observe experiments", "distributed": "cluster",
    "matplotlib": "pictures", "scipy": "experiments",
    "mpmath": "dev", "hypothesis": "dev", "pytest": "dev", "mypy": "dev", "psutil": "observe cluster dev",
    "sphinx": "docs", "docutils": "docs", "furo": "docs", "myst_parser": "docs",
}  # fmt: skip
"""Modules beyond the base, by the extras that bring them."""
ACTORS = ("actors.world.__main__", "actors.radio.__main__", "actors.robot.__main__")
ON_BOARD = ("firmware_bridge.onboard.base", "firmware_bridge.onboard.bridge", "serial")
STARTS = {
    "run": ("deploy.run.swarm", "actors.processes.forkserver", *ACTORS),
    "run --view": ("deploy.run.swarm", "observation.view.__main__"),
    "fleet watch --view": ("deploy.fleet.fleet_file", "deploy.fleet.watched"),
    "run --control": ("deploy.run.swarm", "deploy.control.__main__"),
    "run --hardware-in-the-loop": ("firmware_bridge.laboratory.__main__", *ACTORS[2:], *ON_BOARD),
    "view": (
        *("observation.view.command", "observation.view.beside", "observation.trace.program"),
        *("actors.processes.forkserver", *ACTORS),
    ),
    "explain": ("observation.trace.program", "actors.processes.forkserver", *ACTORS),
    "export": ("observation.trace.program", "actors.processes.forkserver", *ACTORS),
    "export --mcap": (
        *("observation.robot_logs.logging_run", "observation.trace.program"),
        *("actors.processes.forkserver", *ACTORS),
    ),
    "view --png": ("observation.evidence.run_evidence", "observation.picture.run_page"),
    "view --html": ("observation.picture.run_html", "observation.picture.moving"),
    "fleet onboard": ("actors.robot.__main__", *ON_BOARD),
    "verify onboard": ("firmware_bridge.laboratory.__main__", *ACTORS, *ON_BOARD),
    "verify bundle": ("firmware_bridge.laboratory.__main__", ACTORS[2], "serial", "cryptography"),
    "verify standstill": ("firmware_bridge.laboratory.__main__", ACTORS[2], *ON_BOARD),
    "verify endings": ("deploy.run.swarm", "actors.processes.forkserver", *ACTORS),
    "verify crowded-start": ("deploy.run.swarm", "actors.processes.forkserver", *ACTORS),
    "verify resume": (
        "command_line.experiments.campaign_command",
        "experiments.campaign.trial_program",
        *ACTORS,
    ),
    "bench budget": ("deploy.run.swarm", *ACTORS),
    "bench beside": ("deploy.run.swarm", *ACTORS),
    "bench start": ("deploy.run.swarm", *ACTORS),
    "bench recordings": ("deploy.run.swarm", *ACTORS),
    "verify attacks": ("deploy.run.swarm", *ACTORS),
    "verify processors": ("deploy.run.swarm", *ACTORS),
    "verify container": ("deploy.run.swarm", "actors.processes.forkserver", *ACTORS),
    "verify same-bits": ("actors.processes.forkserver", *ACTORS),
    "verify functions": ("mpmath",),
    "bench swarm": ("benchmarks.swarm.ping_pong.__main__", *ACTORS),
    "fleet keys": ("deploy.hosts.certificates",),
    "bench hosts": ("deploy.hosts.recruits", "deploy.hosts.run_hosts", *ACTORS),
    "run --on x": ("deploy.hosts.recruits", "deploy.hosts.run_hosts", "deploy.hosts.host_program"),
    "campaign --on x": ("experiments.campaign.dask_pool", "experiments.campaign.remote"),
    "campaign": (
        "experiments.campaign.trial_program",
        "experiments.campaign.results_table",
        "actors.processes.forkserver",
        *ACTORS,
    ),
    "docs": ("command_line.documentation.site", "command_line.documentation.sources", "furo", "myst_parser"),
}
"""What a command starts or imports beside what its function imports itself."""
MEASURED = {
    **{f"verify {name}": claim.module for name, claim in CHECKED.items()},
    **{f"bench {name}": one.module for name, one in BENCHMARKS.items()},
}
"""The module that a command imports by name."""
PROGRAM = """
import importlib, json, sys
blocked, commands = json.loads(sys.argv[1])
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
for command, modules in commands.items():
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            print(f"{command}: {module}: {error}")
"""


def functions() -> dict[str, ast.FunctionDef]:
    """The function behind every command, by the words that call it."""
    found = {}
    tree: list[tuple[str, typer.Typer]] = [("", app)]
    for prefix, one in tree:
        tree += [
            (f"{prefix}{group.name} ", group.typer_instance)
            for group in one.registered_groups
            if group.typer_instance
        ]
        for command in one.registered_commands:
            callback = command.callback
            assert callback is not None
            name = command.name or callback.__name__.replace("_", "-")
            source = Path(str(sys.modules[callback.__module__].__file__))
            found[prefix + name] = _definition(source, callback.__name__)
    for name, (module, function) in COMMANDS.items():
        if not isinstance(getattr(import_module(module), function), typer.Typer):
            found[name] = _definition(Path(str(sys.modules[module].__file__)), function)
    return found


def _definition(source: Path, function: str) -> ast.FunctionDef:
    body = ast.parse(source.read_text()).body
    return next(node for node in body if isinstance(node, ast.FunctionDef) and node.name == function)


def imported(function: ast.FunctionDef) -> list[str]:
    """Modules that a function imports."""
    names = []
    for node in ast.walk(function):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                deeper = f"{node.module}.{alias.name}"
                path = ROOT / deeper.replace(".", "/")
                names.append(
                    deeper if path.is_dir() or path.with_suffix(".py").is_file() else str(node.module)
                )
    return names


def extras(words: str) -> tuple[str, ...]:
    """What the script installs for a command."""
    text = (ROOT / "acrc").read_text()
    body = re.search(r"^extras_for\(\) \{.*?^\}$", text, re.MULTILINE | re.DOTALL)
    assert body is not None
    done = subprocess.run(
        ["sh", "-c", f'{body[0]}\nextras_for "$@"', "sh", *words.split()],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return tuple(sorted(set(done.stdout.split())))


def commands() -> dict[str, list[str]]:
    """What each command imports sooner or later, by its words."""
    found = {name: [*imported(function), *STARTS.get(name, ())] for name, function in functions().items()}
    found |= {name: [module, *STARTS.get(name, ())] for name, module in MEASURED.items()}
    found["run"] = list(STARTS["run"])
    found |= {name: list(starts) for name, starts in STARTS.items() if name not in found}
    return {name: modules for name, modules in found.items() if name not in {"test", "check", "add"}}


def by_extras() -> dict[tuple[str, ...], dict[str, list[str]]]:
    groups: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for name, modules in commands().items():
        groups.setdefault(extras(name), {})[name] = modules
    return groups


def test_every_command_is_looked_at() -> None:
    some = {
        *("run", "list presets", "list maps", "verify onboard", "bench world"),
        *("fleet onboard", "fleet watch", "fleet stop", "fleet collect", "fleet doctor", "fleet keys"),
    }
    assert some <= set(commands())
    assert all(modules for name, modules in commands().items() if name != "order") and len(commands()) > 25


def starts_processes(module: str, seen: set[str]) -> bool:
    """True if a benchmark's module, or one of the benchmarks that it imports, runs Python anew."""
    path = ROOT / module.replace(".", "/")
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if module in seen or not path.is_file():
        return False
    seen.add(module)
    source = path.read_text()
    deeper = [name for name in re.findall(r"\b(benchmarks(?:\.\w+)+)", source) if name != module]
    deeper += [f"benchmarks.{name}" for name in re.findall(r"^from benchmarks import (\w+)", source, re.M)]
    return "sys.executable" in source or any(starts_processes(name, seen) for name in deeper)


def test_what_a_benchmark_starts_is_looked_at_too() -> None:
    starting = {name for name, module in MEASURED.items() if starts_processes(module, set())}
    assert "verify standstill" in starting
    assert starting <= set(STARTS)


@pytest.mark.parametrize("present", sorted(by_extras()), ids=lambda present: "+".join(("base", *present)))
def test_what_is_installed_for_a_command_is_all_that_it_imports(present: tuple[str, ...]) -> None:
    blocked = [module for module, extra in MODULES.items() if not {*extra.split()} & {*present}]
    done = subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM, json.dumps([blocked, by_extras()[present]])],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, ""), done.stderr


HELP = """
import json, sys
blocked = json.loads(sys.argv[1])
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from command_line.documentation.commands import tree
for words, command in tree().items():
    if command.get_help(command.make_context(words, [], resilient_parsing=True)):
        print(words)
"""


def test_the_help_of_every_command_needs_the_base_alone() -> None:
    done = subprocess.run(
        [sys.executable, "-P", "-c", HELP, json.dumps(list(MODULES))],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert {f"acrc {name}".strip() for name in functions()} <= {*done.stdout.splitlines()}
