"""`acrc bench`: measurements of time and memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from acrc_testbed.command_line import options
from acrc_testbed.command_line.options import Json


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
        "swarm.benchmark", "the whole stack: speed, CPU by package, traffic, memory",
        ("robots", "duration", "repeat"),
    ),
    "budget": Benchmark(
        "swarm.budget", "what one robot's step costs, counted: calls, messages, bytes",
        ("duration", "bus", "write"),
    ),
    "beside": Benchmark(
        "swarm.beside", "this state and another COMMIT in turn: wall and CPU time, digests",
        ("commit", "robots", "duration", "seed", "scenario", "bus", "pairs", "navigation"),
    ),
    "hosts": Benchmark(
        "hosts", "a swarm over 1 to 3 network namespaces as hosts, by delay",
        ("robots", "duration"),
    ),
    "start": Benchmark(
        "swarm.start", "from Enter to a command's first word, and to a run's first step",
        ("robots", "repeat"),
    ),
    "radio": Benchmark(
        "radio.benchmark", "the medium; with --out the figures of docs/radio.md",
        ("out", "data", "map_file"),
    ),
    "world": Benchmark("world", "physics and scans beside other simulators", ("map_file",)),
}  # fmt: skip


def names() -> list[str]:
    """Return the names, for completion."""
    return list(BENCHMARKS)


def bench(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help=f"{', '.join(BENCHMARKS)}.", autocompletion=names)
    ] = None,
    commit: Annotated[
        str | None,
        typer.Argument(metavar="COMMIT", help="beside: a commit, or the folder of a clone."),
    ] = None,
    robots: Annotated[
        list[int] | None,
        typer.Option(
            metavar="N",
            min=1,
            max=1000,
            help="swarm, start, beside, hosts: number of robots. Repeatable.",
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=1,
            max=3600,
            help="swarm, budget, beside, hosts: simulated seconds.",
        ),
    ] = None,
    repeat: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=100, help="swarm, start: number of runs whose median counts."),
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", min=0, help="beside: random seed.")] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="SCENARIO.toml",
            help="beside: run this scenario.",
            autocompletion=options.scenarios,
        ),
    ] = None,
    bus: Annotated[
        str | None,
        typer.Option(
            metavar="zenoh|memory",
            help="budget, beside: run on this bus.  [default: budget: both; beside: zenoh]",
        ),
    ] = None,
    pairs: Annotated[
        int | None,
        typer.Option(metavar="N", min=2, max=1000, help="beside: number of pairs of runs.  [default: 5]"),
    ] = None,
    navigation: Annotated[
        str | None,
        typer.Option(
            metavar="PRESET",
            help="beside: run this state, not the other, with it.",
            autocompletion=options.navigation,
        ),
    ] = None,
    write: Annotated[
        bool | None, typer.Option("--write", help="budget: keep the counts as what a change is held to.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="radio: only draw the figures, into this folder.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="radio --out: draw these rows of ns-3 as dots.")
    ] = None,
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="YAML", help="world, radio --out: use this map.")
    ] = None,
    json: Json = False,
) -> None:
    """Measure time and memory; without NAME, list the benchmarks."""
    from acrc_testbed.benchmarks.measured import tell
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
    }  # fmt: skip
    settings = _given(options, name)
    found = import_module(f"acrc_testbed.benchmarks.{BENCHMARKS[name].module}").measure(**settings)
    raise typer.Exit(tell(found, json_output=json))


_WORDS: Final = {"map_file": "--map", "commit": "COMMIT"}
"""How the command line spells settings that have another name there."""


def _given(options: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the options that were given. Raises OptionError for one that this benchmark does not take."""
    from actors.installation.usage import OptionError

    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        if option not in BENCHMARKS[name].takes:
            others = ", ".join(taker for taker, one in BENCHMARKS.items() if option in one.takes)
            word = _WORDS.get(option, f"--{option.replace('_', '-')}")
            raise OptionError(f"{word}: is not for {name}, but for {others}")
    return given
