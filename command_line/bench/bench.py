"""`acrc bench`: what is measured in time and memory."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Final

import typer

from command_line import completion
from command_line.options import Json


@dataclass(frozen=True)
class Benchmark:
    """One of them."""

    module: str
    """Has the function `measure`, which gives `Measured`."""
    says: str
    takes: tuple[str, ...] = ()
    """Settings of `measure` that can be given on the command line."""


BENCHMARKS: Final = {
    "swarm": Benchmark(
        "benchmarks.swarm.benchmark", "the whole stack: speed, CPU by part, traffic, memory",
        ("robots", "duration", "repeat"),
    ),
    "recordings": Benchmark(
        "benchmarks.recordings.recordings", "recording a swarm, and replaying a robot", ("robots", "duration")
    ),
    "relays": Benchmark(
        "benchmarks.swarm.relays", "rules of relaying: what robots hear, how old what they know is",
        ("robots", "duration", "below", "seeds", "seed", "scenario"),
    ),
    "budget": Benchmark(
        "benchmarks.swarm.counted.command", "what one robot's step costs, counted: calls, messages, bytes",
        ("duration", "bus", "write"),
    ),
    "beside": Benchmark(
        "benchmarks.beside.command", "this state and another COMMIT in turn: wall and CPU time, digests",
        ("commit", "robots", "duration", "seed", "scenario", "bus", "pairs", "navigation"),
    ),
    "hosts": Benchmark(
        "benchmarks.hosts.benchmark", "a swarm over 1 to 3 network namespaces as hosts, by delay",
        ("robots", "duration"),
    ),
    "start": Benchmark(
        "benchmarks.swarm.start", "from Enter to a command's first word, and to a run's first step",
        ("robots", "repeat"),
    ),
    "radio": Benchmark(
        "benchmarks.radio.benchmark", "the medium; with --out the figures of docs/radio.md",
        ("out", "data", "map_file"),
    ),
    "world": Benchmark("benchmarks.world.world", "physics and scans beside other simulators", ("map_file",)),
    "deeco": Benchmark("benchmarks.foundations.deeco", "the component model"),
    "functions": Benchmark("benchmarks.foundations.portable", "elementary functions beside the C library's"),
}  # fmt: skip
"""By name."""


def names() -> list[str]:
    """For completion."""
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
            help="swarm, start, recordings, relays, beside, hosts: number of robots. Repeatable.",
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            min=1,
            max=3600,
            help="swarm, recordings, relays, budget, beside, hosts: simulated seconds.",
        ),
    ] = None,
    repeat: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=100, help="swarm, start: number of runs whose median counts."),
    ] = None,
    below: Annotated[
        list[float] | None,
        typer.Option(metavar="DBM", min=-90, max=0, help="relays: try this threshold. Repeatable."),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=10_000, help="relays: number of seeds.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="relays: first seed; beside: random seed.")
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="SCENARIO.toml",
            help="relays, beside: run this scenario.",
            autocompletion=completion.scenarios,
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
            autocompletion=completion.navigation,
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
    """Measure time and memory; without NAME, list what of."""
    from actors.installation.usage import wrong_value
    from benchmarks.claims.verification import told
    from command_line.bench.options import given

    if name is None:
        for known, one in BENCHMARKS.items():
            print(f"{known:<12}{one.says}")
        return
    if name not in BENCHMARKS:
        raise wrong_value("NAME", name, f"one of {', '.join(BENCHMARKS)}")
    options = {
        "commit": commit, "robots": robots, "duration": duration, "repeat": repeat,
        "below": below, "seeds": seeds, "seed": seed, "scenario": scenario, "out": out, "data": data,
        "map_file": map_file, "bus": bus, "pairs": pairs, "write": write, "navigation": navigation,
    }  # fmt: skip
    settings = given(options, {known: one.takes for known, one in BENCHMARKS.items()}, (name,))
    found = import_module(BENCHMARKS[name].module).measure(**settings)
    raise typer.Exit(told(found, json_output=json))
