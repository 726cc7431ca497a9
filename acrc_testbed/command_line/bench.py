"""Commands `acrc bench` (time and memory) and `acrc verify` (claims and reference data)."""

import json as json_module
import re
import sys
import tempfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from acrc_testbed.command_line import shared_options
from acrc_testbed.command_line.shared_options import Json, argument, flag, option, suggestion


@dataclass(frozen=True)
class Benchmark:
    """One benchmark."""

    module: str
    """Module with a function `measure` that returns a `BenchmarkResult`."""
    summary: str
    options: tuple[str, ...]
    """Parameters of `measure` that the command line accepts."""


BENCHMARKS: Final = {
    "swarm": Benchmark(
        "swarm_speed", "whole stack: speed, CPU by package, traffic, memory",
        ("robots", "duration", "repeat"),
    ),
    "budget": Benchmark(
        "budget", "counted cost of a robot-step: calls, messages, bytes",
        ("duration", "bus", "write"),
    ),
    "beside": Benchmark(
        "commit_comparison", "this state and COMMIT alternately: wall and CPU time, digests",
        ("commit", "robots", "duration", "seed", "scenario", "bus", "pairs", "navigation", "record"),
    ),
    "hosts": Benchmark(
        "hosts", "a swarm on 1 to 3 emulated hosts, by network delay",
        ("robots", "duration"),
    ),
    "start": Benchmark(
        "swarm_start", "start-up time of commands and runs",
        ("robots", "repeat"),
    ),
    "radio": Benchmark(
        "radio", "radio medium; with --out the figures of docs/radio.md",
        ("out", "data", "map_file"),
    ),
    "world": Benchmark("world", "physics and scans compared with other simulators", ("map_file",)),
}  # fmt: skip


def bench(
    name: Annotated[
        str | None,
        argument("NAME", f"Benchmark: {', '.join(BENCHMARKS)}.", autocompletion=lambda: list(BENCHMARKS)),
    ] = None,
    commit: Annotated[str | None, argument("COMMIT", "beside: a commit, or the folder of a clone.")] = None,
    robots: Annotated[
        list[int] | None,
        option("N", "swarm, start, beside, hosts: use this many robots. Repeatable.", min=1, max=1000),
    ] = None,
    duration: Annotated[
        float | None,
        option("S", "swarm, budget, beside, hosts: simulate this many seconds.", min=1, max=3600),
    ] = None,
    repeat: Annotated[
        int | None, option("N", "swarm, start: report the median of this many runs.", min=1, max=100)
    ] = None,
    seed: Annotated[int | None, option("N", "beside: set the random seed.", min=0)] = None,
    scenario: Annotated[
        Path | None,
        option("SCENARIO.toml", "beside: run this scenario.", autocompletion=shared_options.scenarios),
    ] = None,
    bus: Annotated[
        str | None,
        option("zenoh|memory", "budget, beside: run on this bus.  [default: budget: both; beside: zenoh]"),
    ] = None,
    pairs: Annotated[
        int | None, option("N", "beside: run this many pairs.  [default: 5]", min=2, max=1000)
    ] = None,
    navigation: Annotated[
        str | None,
        option(
            "PRESET", "beside: use this preset in this state only.", autocompletion=shared_options.navigation
        ),
    ] = None,
    record: Annotated[
        str | None,
        option("full|lean", "beside: record this much in this state only.  [default: full]"),
    ] = None,
    write: Annotated[bool | None, flag("budget: save the counts as the new limits.", "--write")] = None,
    out: Annotated[Path | None, option("DIR", "radio: only draw the figures, into this folder.")] = None,
    data: Annotated[Path | None, option("DIR", "radio --out: also draw these results of ns-3.")] = None,
    map_file: Annotated[Path | None, option("YAML", "world, radio --out: use this map.", "--map")] = None,
    json: Json = False,
) -> None:
    """Measure time and memory; without NAME, list benchmarks."""
    arguments = locals()
    options_set = {
        key: value for key, value in arguments.items() if key not in {"name", "json"} and value is not None
    }
    from actors.installation.usage import wrong_value

    if name is None:
        for known, one in BENCHMARKS.items():
            print(f"{known:<12}{one.summary}")
        return
    if name not in BENCHMARKS:
        raise wrong_value("NAME", name, f"one of {', '.join(BENCHMARKS)}")
    _check_accepted(
        options_set,
        {known: one.options for known, one in BENCHMARKS.items()},
        name,
        f"not an option of {name}, but of",
    )
    measure = import_module(f"acrc_testbed.benchmarks.{BENCHMARKS[name].module}").measure
    raise typer.Exit(measure(**options_set).report(json_output=json))


_SPELLINGS: Final = {"map_file": "--map", "commit": "COMMIT"}
"""Command-line names of parameters, where they differ."""


def _check_accepted(
    options_set: Iterable[str], accepted: Mapping[str, Collection[str]], name: str, problem: str
) -> None:
    """Raise OptionError for an option that `accepted` lists for other names than `name`."""
    from actors.installation.usage import OptionError

    for key in options_set:
        if key not in accepted.get(name, ()):
            others = ", ".join(other for other, options in accepted.items() if key in options)
            raise OptionError(f"{_SPELLINGS.get(key, f'--{key}')}: {problem} {others}")


_MARKER: Final = re.compile(r"""mark\.claim\(\s*["']([\w-]+)["']\s*\)""")
_COMMAND: Final = re.compile(r"`acrc verify ([\w-]+)")
_COMPLETE: Final = (0, 1, 5)
"""Exit codes of pytest after a complete run: all passed, some failed, no tests selected."""
_SHOWN_FIGURES: Final = 5
_NIGHTLY: Final = "nightly: name the claim, or use --full"


@dataclass(frozen=True)
class ClaimResult:
    """Outcome of all tests of one claim."""

    claim: str
    tests: Sequence[Mapping[str, Any]]
    """Rows of the report that tests/conftest.py writes."""

    @property
    def holds(self) -> bool | None:
        """False if a test failed; None if none ran."""
        outcomes = {test["outcome"] for test in self.tests}
        return False if "failed" in outcomes else True if "passed" in outcomes else None

    @property
    def verdict(self) -> str:
        """The verdict in words, with the reason of a skip."""
        if self.holds is not None:
            return "holds" if self.holds else "DOES NOT HOLD"
        return f"skipped: {self.tests[0]['reason'] if self.tests else _NIGHTLY}"

    @property
    def seconds(self) -> float:
        """Duration of its tests, s."""
        return float(round(sum(test["seconds"] for test in self.tests), 1))

    @property
    def figures(self) -> str:
        """The first figures of the tests as text, without lists and tables."""
        named = [(name, value) for test in self.tests for name, value in test["figures"].items()]
        scalars = [f"{name} {value}" for name, value in named if not isinstance(value, list | dict)]
        return ", ".join(scalars[:_SHOWN_FIGURES])


def claims() -> list[str]:
    """Return the names of all claims, for completion."""
    from actors.installation.repository import IS_CLONE, REPOSITORY

    return sorted(_claim_files(REPOSITORY)) if IS_CLONE else []


def verify(
    claim: Annotated[
        list[str] | None,
        argument(
            "CLAIM", "Check only these claims; --list names them.  [default: all]", autocompletion=claims
        ),
    ] = None,
    listed: Annotated[bool, flag("List the claims and the files of their tests.", "--list")] = False,
    full: Annotated[bool, flag("Run tests at the size reported in docs/how-true.md.", "--full")] = False,
    data: Annotated[Path | None, option("DIR", "radio: compare with these results of ns-3.")] = None,
    source: Annotated[
        Path | None,
        option(
            "FILE|DIR",
            "localisation: run the filter on these logs; navigation: compare with these results.",
            "--from",
        ),
    ] = None,
    runs: Annotated[
        int | None,
        option(
            "N",
            "radio --data: send this many frames per frame of ns-3; localisation --from: number of runs.",
            min=1,
            max=10_000,
        ),
    ] = None,
    against: Annotated[
        Path | None, option("JSON", "localisation --from: compare with the results of another localisation.")
    ] = None,
    json: Json = False,
) -> None:
    """Run the tests of the claims in docs/how-true.md.

    Requires a clone. With --data or --from, compare the radio, the localisation or the navigation with given
    data instead. The exit code is 1 if a claim does not hold.
    """
    options = {"data": data, "from": source, "runs": runs, "against": against}
    options_set = {name: value for name, value in options.items() if value is not None}
    if options_set:
        raise typer.Exit(_compare_data(claim or [], options_set, json_output=json))
    from actors.installation.repository import clone

    root = clone("verify")
    files = _claim_files(root)
    chosen = _chosen_claims(claim or [], files)
    if listed:
        _print_claims(root, {name: files[name] for name in chosen}, json_output=json)
        return
    results = _run_claims(root, {name: files[name] for name in chosen}, named=bool(claim), full=full)
    _print_results(results, json_output=json)
    raise typer.Exit(1 if any(result.holds is False for result in results) else 0)


_COMPARISON_OPTIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "radio": {"data": None, "runs": 10},
    "localisation": {"from": None, "runs": 20, "against": None},
    "navigation": {"from": None},
}
"""Options of each comparison with their defaults, in the order of its arguments; the first is required."""


def _compare_data(names: Sequence[str], options_set: dict[str, Any], *, json_output: bool) -> int:
    """Compare with the user's data and return the exit code. Raises OptionError, AcrcError."""
    from actors.installation.usage import OptionError

    name = names[0] if len(names) == 1 else ""
    problem = f"not an option of {', '.join(names)}, but of" if names else "requires a claim:"
    _check_accepted(options_set, _COMPARISON_OPTIONS, name, problem)
    own = _COMPARISON_OPTIONS[name]
    if (required := next(iter(own))) not in options_set:
        raise OptionError(f"--{next(iter(options_set))}: requires --{required}, the data to compare with")
    module = name if name == "navigation" else f"{name}_comparison"
    check = import_module(f"acrc_testbed.benchmarks.{module}").check
    found = check(*{**own, **options_set}.values())
    if not json_output and found.holds is not None:
        found = found.with_line(f"{name}: {'holds' if found.holds else 'DOES NOT HOLD'}")
    return int(found.report(json_output=json_output))


def _claim_files(root: Path) -> dict[str, list[str]]:
    """Return the test files of each claim, relative to the clone."""
    found: dict[str, list[str]] = {}
    for path in sorted((root / "tests").rglob("test_*.py")):
        for name in dict.fromkeys(_MARKER.findall(path.read_text("utf-8"))):
            found.setdefault(name, []).append(str(path.relative_to(root)))
    return dict(sorted(found.items()))


def _chosen_claims(names: Sequence[str], known: Mapping[str, object]) -> list[str]:
    """Return the claims of these names; all without names. Raises OptionError for an unknown one."""
    from actors.installation.usage import OptionError

    for name in names:
        if name not in known:
            raise OptionError(f"CLAIM: unknown claim {name}; {suggestion(name, known)}")
    return list(dict.fromkeys(names or known))


def statements(root: Path) -> dict[str, str]:
    """Return the statement of each claim, from the rows of docs/how-true.md."""
    rows = [line.split("|") for line in (root / "docs" / "how-true.md").read_text("utf-8").splitlines()]
    return {
        found[1]: cells[1].strip()
        for cells in rows
        if len(cells) > 2 and (found := _COMMAND.search(cells[-2])) is not None
    }


def _print_claims(root: Path, files: Mapping[str, Sequence[str]], *, json_output: bool) -> None:
    known = statements(root)
    rows = [{"name": name, "says": known.get(name, ""), "files": list(its)} for name, its in files.items()]
    table = Table("claim", "statement", "tests", title="acrc verify CLAIM …")
    for row in rows:
        table.add_row(str(row["name"]), str(row["says"]).replace("`", ""), "\n".join(row["files"]))
    _print_table(rows, table, json_output=json_output)


def _run_claims(
    root: Path, files: Mapping[str, Sequence[str]], *, named: bool, full: bool
) -> list[ClaimResult]:
    """Run the tests of these claims, with progress on standard error.

    Nightly tests run only if the claims are `named` or in `full` size. Raises AcrcError if pytest aborts.
    """
    from acrc_testbed.command_line.development import run_pytest
    from actors.processes.kernel_compilation import compile_kernels
    from actors.runtime.errors import AcrcError

    marked = "claim" if named or full else "claim and not nightly"
    words = [*dict.fromkeys(chain(*files.values())), "-m", marked, "-v", "--no-header"]
    words += [f"--claim={name}" for name in files]
    compile_kernels()
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        report = Path(folder) / "claims.jsonl"
        words += ["--claim-report", str(report), *(["--full"] if full else [])]
        code = run_pytest(root, words, stdout=sys.stderr)
        lines = report.read_text("utf-8").splitlines() if report.exists() else []
    if code not in _COMPLETE:
        raise AcrcError(f"verify: pytest aborted with exit code {code}; see above")
    rows = [json_module.loads(line) for line in lines]
    return [ClaimResult(name, [row for row in rows if row["claim"] == name]) for name in files]


def _print_results(results: Sequence[ClaimResult], *, json_output: bool) -> None:
    figures = {
        result.claim: {"holds": result.holds, "s": result.seconds, "tests": result.tests}
        for result in results
    }
    table = Table("claim", "result", "s", "figures")
    for result in results:
        table.add_row(result.claim, result.verdict, f"{result.seconds:.0f}", result.figures)
    _print_table(figures, table, json_output=json_output)


def _print_table(figures: Any, table: Table, *, json_output: bool) -> None:
    from acrc_testbed.benchmarks.benchmark_result import BenchmarkResult

    BenchmarkResult(figures, (table,)).report(json_output=json_output)
