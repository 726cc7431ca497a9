"""`acrc bench`: measurements of time and memory; `acrc verify`: claims and reference data."""

import difflib
import json as json_module
import re
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from acrc_testbed.command_line import options
from acrc_testbed.command_line.options import Json, argument, flag, option


@dataclass(frozen=True)
class Benchmark:
    """One benchmark."""

    module: str
    """Its function `measure` returns `Measured`."""
    says: str
    takes: tuple[str, ...] = ()
    """Settings of `measure` that the command line accepts."""


BENCHMARKS: Final = {
    "swarm": Benchmark(
        "swarm", "the whole stack: speed, CPU by package, traffic, memory",
        ("robots", "duration", "repeat"),
    ),
    "budget": Benchmark(
        "budget", "what one robot's step costs, counted: calls, messages, bytes",
        ("duration", "bus", "write"),
    ),
    "beside": Benchmark(
        "beside", "this state and another COMMIT in turn: wall and CPU time, digests",
        ("commit", "robots", "duration", "seed", "scenario", "bus", "pairs", "navigation", "record"),
    ),
    "hosts": Benchmark(
        "hosts", "a swarm over 1 to 3 network namespaces as hosts, by delay",
        ("robots", "duration"),
    ),
    "start": Benchmark(
        "swarm_start", "from Enter to a command's first word, and to a run's first step",
        ("robots", "repeat"),
    ),
    "radio": Benchmark(
        "radio", "the medium; with --out the figures of docs/radio.md",
        ("out", "data", "map_file"),
    ),
    "world": Benchmark("world", "physics and scans beside other simulators", ("map_file",)),
}  # fmt: skip


def bench(
    name: Annotated[
        str | None, argument("NAME", f"{', '.join(BENCHMARKS)}.", autocompletion=lambda: list(BENCHMARKS))
    ] = None,
    commit: Annotated[str | None, argument("COMMIT", "beside: a commit, or the folder of a clone.")] = None,
    robots: Annotated[
        list[int] | None,
        option("N", "swarm, start, beside, hosts: number of robots. Repeatable.", min=1, max=1000),
    ] = None,
    duration: Annotated[
        float | None, option("S", "swarm, budget, beside, hosts: simulated seconds.", min=1, max=3600)
    ] = None,
    repeat: Annotated[
        int | None, option("N", "swarm, start: number of runs whose median counts.", min=1, max=100)
    ] = None,
    seed: Annotated[int | None, option("N", "beside: random seed.", min=0)] = None,
    scenario: Annotated[
        Path | None, option("SCENARIO.toml", "beside: run this scenario.", autocompletion=options.scenarios)
    ] = None,
    bus: Annotated[
        str | None,
        option("zenoh|memory", "budget, beside: run on this bus.  [default: budget: both; beside: zenoh]"),
    ] = None,
    pairs: Annotated[
        int | None, option("N", "beside: number of pairs of runs.  [default: 5]", min=2, max=1000)
    ] = None,
    navigation: Annotated[
        str | None,
        option(
            "PRESET", "beside: run this state, not the other, with it.", autocompletion=options.navigation
        ),
    ] = None,
    record: Annotated[
        str | None,
        option("full|lean", "beside: how much this state, not the other, records.  [default: full]"),
    ] = None,
    write: Annotated[
        bool | None, flag("budget: keep the counts as what a change is held to.", "--write")
    ] = None,
    out: Annotated[Path | None, option("DIR", "radio: only draw the figures, into this folder.")] = None,
    data: Annotated[Path | None, option("DIR", "radio --out: draw these rows of ns-3 as dots.")] = None,
    map_file: Annotated[Path | None, option("YAML", "world, radio --out: use this map.", "--map")] = None,
    json: Json = False,
) -> None:
    """Measure time and memory; without NAME, list the benchmarks."""
    from actors.installation.usage import wrong_value

    if name is None:
        for known, one in BENCHMARKS.items():
            print(f"{known:<12}{one.says}")
        return
    if name not in BENCHMARKS:
        raise wrong_value("NAME", name, f"one of {', '.join(BENCHMARKS)}")
    options = {
        "commit": commit, "robots": robots, "duration": duration, "repeat": repeat,
        "seed": seed, "scenario": scenario, "out": out, "data": data,
        "map_file": map_file, "bus": bus, "pairs": pairs, "write": write, "navigation": navigation,
        "record": record,
    }  # fmt: skip
    given = {key: value for key, value in options.items() if value is not None}
    _check_taken(
        given, {known: one.takes for known, one in BENCHMARKS.items()}, name, f"is not for {name}, but for"
    )
    measure = import_module(f"acrc_testbed.benchmarks.{BENCHMARKS[name].module}").measure
    raise typer.Exit(measure(**given).tell(json_output=json))


_SPELLINGS: Final = {"map_file": "--map", "commit": "COMMIT"}
"""How the command line spells parameters that have another name."""


def _check_taken(given: Iterable[str], takes: Mapping[str, Sequence[str]], name: str, wrong: str) -> None:
    """Raise OptionError for an option that is for others of `takes` than for `name`."""
    from actors.installation.usage import OptionError

    for key in given:
        if key not in takes.get(name, ()):
            others = ", ".join(taker for taker, its in takes.items() if key in its)
            raise OptionError(f"{_SPELLINGS.get(key, f'--{key}')}: {wrong} {others}")


_MARKER: Final = re.compile(r"""mark\.claim\(\s*["']([\w-]+)["']\s*\)""")
_COMMAND: Final = re.compile(r"`acrc verify ([\w-]+)")
_COMPLETE: Final = (0, 1, 5)
"""Exit codes of pytest after a complete run: all passed, some failed, no tests selected."""
_SHOWN_FIGURES: Final = 5
_NIGHTLY: Final = "nightly: name the claim, or give --full"


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
        """The verdict for people, with the reason of a skip."""
        if self.holds is not None:
            return "holds" if self.holds else "DOES NOT HOLD"
        return f"skipped: {self.tests[0]['reason'] if self.tests else _NIGHTLY}"

    @property
    def seconds(self) -> float:
        """Duration of its tests, s."""
        return float(round(sum(test["seconds"] for test in self.tests), 1))

    @property
    def figures(self) -> str:
        """The first figures of its tests as text, without lists and tables."""
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
    full: Annotated[bool, flag("Run the size that docs/how-true.md reports.", "--full")] = False,
    data: Annotated[Path | None, option("DIR", "radio: compare with these rows of ns-3.")] = None,
    source: Annotated[
        Path | None,
        option(
            "FILE|DIR",
            "localisation: feed the filter with these logs; navigation: compare with these rows.",
            "--from",
        ),
    ] = None,
    runs: Annotated[
        int | None,
        option(
            "N",
            "radio --data: number of own frames per frame of ns-3; localisation --from: number of runs.",
            min=1,
            max=10_000,
        ),
    ] = None,
    against: Annotated[
        Path | None, option("JSON", "localisation --from: compare with the results of another localisation.")
    ] = None,
    json: Json = False,
) -> None:
    """Run the tests of the claims of docs/how-true.md.

    This needs a clone. With --data or --from, compare the radio, the localisation or the navigation with
    given data instead. The exit code is 1 if a claim does not hold.
    """
    options = {"data": data, "from": source, "runs": runs, "against": against}
    given = {name: value for name, value in options.items() if value is not None}
    if given:
        raise typer.Exit(_compare(claim or [], given, json_output=json))
    from actors.installation.repository import clone

    root = clone("verify")
    files = _claim_files(root)
    chosen = _chosen(claim or [], files)
    if listed:
        _show_list(root, {name: files[name] for name in chosen}, json_output=json)
        return
    results = _run(root, {name: files[name] for name in chosen}, named=bool(claim), full=full)
    _show(results, json_output=json)
    raise typer.Exit(1 if any(result.holds is False for result in results) else 0)


_TAKES: Final = {
    "radio": ("data", "runs"),
    "localisation": ("from", "runs", "against"),
    "navigation": ("from",),
}
"""Options of each comparison; the first one is required."""


def _compare(names: Sequence[str], given: dict[str, Any], *, json_output: bool) -> int:
    """Compare with the user's data and return the exit code. Raises OptionError, AcrcError."""
    from actors.installation.usage import OptionError

    name = names[0] if len(names) == 1 else ""
    wrong = f"is not for {', '.join(names)}, but for" if names else "must stand beside what it is for:"
    _check_taken(given, _TAKES, name, wrong)
    if (required := _TAKES[name][0]) not in given:
        raise OptionError(f"--{next(iter(given))}: requires --{required}, the data to compare with")
    if name == "radio":
        from acrc_testbed.benchmarks.radio_comparison import check as radio

        found = radio(given["data"], given.get("runs", 10))
    elif name == "localisation":
        from acrc_testbed.benchmarks.localisation_comparison import check as localisation

        found = localisation(given["from"], given.get("runs", 20), given.get("against"))
    else:
        from acrc_testbed.benchmarks.navigation import check as navigation

        found = navigation(given["from"])
    if not json_output and found.holds is not None:
        found = found.with_line(f"{name}: {'holds' if found.holds else 'DOES NOT HOLD'}")
    return found.tell(json_output=json_output)


def _claim_files(root: Path) -> dict[str, list[str]]:
    """Return the claims of the marked tests, each with the files of its tests, relative to the clone."""
    found: dict[str, list[str]] = {}
    for path in sorted((root / "tests").rglob("test_*.py")):
        for name in dict.fromkeys(_MARKER.findall(path.read_text("utf-8"))):
            found.setdefault(name, []).append(str(path.relative_to(root)))
    return dict(sorted(found.items()))


def _chosen(names: Sequence[str], known: Mapping[str, object]) -> list[str]:
    """Return the claims of these names; all without names. Raises OptionError for an unknown one."""
    from actors.installation.usage import OptionError

    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            right = f"did you mean {near[0]}?" if near else f"must be one of {', '.join(known)}"
            raise OptionError(f"CLAIM: {name}; {right}")
    return list(dict.fromkeys(names or known))


def statements(root: Path) -> dict[str, str]:
    """Return the statement of each claim, from the rows of docs/how-true.md."""
    rows = [line.split("|") for line in (root / "docs" / "how-true.md").read_text("utf-8").splitlines()]
    return {
        found[1]: cells[1].strip()
        for cells in rows
        if len(cells) > 2 and (found := _COMMAND.search(cells[-2])) is not None
    }


def _show_list(root: Path, files: Mapping[str, Sequence[str]], *, json_output: bool) -> None:
    says = statements(root)
    rows = [{"name": name, "says": says.get(name, ""), "files": list(its)} for name, its in files.items()]
    table = Table("claim", "statement", "tests", title="acrc verify CLAIM …")
    for row in rows:
        table.add_row(str(row["name"]), str(row["says"]).replace("`", ""), "\n".join(row["files"]))
    _print(rows, table, json_output=json_output)


def _run(root: Path, files: Mapping[str, Sequence[str]], *, named: bool, full: bool) -> list[ClaimResult]:
    """Run the tests of these claims; their progress goes to standard error.

    Nightly tests run only if the claims are named or in full size. Raises AcrcError if pytest breaks off.
    """
    from acrc_testbed.command_line.development import run_pytest
    from actors.processes.kernels import compile_kernels
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
        raise AcrcError(f"verify: pytest ended with exit code {code} before it had run all tests; see above")
    rows = [json_module.loads(line) for line in lines]
    return [ClaimResult(name, [row for row in rows if row["claim"] == name]) for name in files]


def _show(results: Sequence[ClaimResult], *, json_output: bool) -> None:
    figures = {
        result.claim: {"holds": result.holds, "s": result.seconds, "tests": result.tests}
        for result in results
    }
    table = Table("claim", "result", "s", "figures")
    for result in results:
        table.add_row(result.claim, result.verdict, f"{result.seconds:.0f}", result.figures)
    _print(figures, table, json_output=json_output)


def _print(figures: Any, table: Table, *, json_output: bool) -> None:
    from acrc_testbed.benchmarks.measured import Measured

    Measured(figures, (table,)).tell(json_output=json_output)
