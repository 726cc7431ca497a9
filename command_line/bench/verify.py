"""`acrc verify`: what docs/how-true.md claims, checked."""

from pathlib import Path
from typing import Annotated

import typer

from command_line import completion
from command_line.options import Json


def claims() -> list[str]:
    """The names, for completion."""
    from benchmarks.claims.verification import CHECKED

    return list(CHECKED)


def verify(
    claim: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="CLAIM",
            help="Check only these; --list names them.  [default: all]",
            autocompletion=claims,
        ),
    ] = None,
    listed: Annotated[bool, typer.Option("--list", help="List the claims, and how long each takes.")] = False,
    full: Annotated[bool, typer.Option("--full", help="Check as much as docs/how-true.md reports.")] = False,
    runs: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=10_000, help="Number of runs of each case.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Random seed; navigation: of the first run.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="S", min=1, max=3600, help="Simulated seconds of each run.")
    ] = None,
    robots: Annotated[
        list[int] | None,
        typer.Option(metavar="N", min=1, max=500, help="Number of robots. Some claims take several."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=256, help="Number of parallel runs.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="radio: compare with these rows of ns-3.")
    ] = None,
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FILE|DIR",
            help="localisation: feed the filter with these logs; navigation: compare with these rows.",
        ),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            metavar="JSON", help="localisation --from: compare with the results of another localisation."
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="localisation, navigation: only write one course as a log."),
    ] = None,
    cell: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="localisation: measure these cells. Repeatable."),
    ] = None,
    maps: Annotated[
        list[Path] | None, typer.Option("--map", metavar="YAML", help="navigation: use this map. Repeatable.")
    ] = None,
    goals: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=100_000, help="navigation: number of goals.")
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="SCENARIO.toml", help="failures: run this scenario.", autocompletion=completion.scenarios
        ),
    ] = None,
    strategy: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="failures: run this strategy.", autocompletion=completion.strategies
        ),
    ] = None,
    localisation: Annotated[
        str | None, typer.Option(metavar="PRESET", help="navigation, failures: preset of localisation.")
    ] = None,
    navigation: Annotated[
        str | None, typer.Option(metavar="PRESET", help="navigation, failures: preset of navigation.")
    ] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="navigation: replace a key of its scenarios: dwa.sim_time=1.7. Repeatable.",
        ),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, max=1000, help="standstill, sensors: number of trials of each case."
        ),
    ] = None,
    hours: Annotated[
        float | None,
        typer.Option(metavar="H", min=0, max=1000, help="sensors: simulated hours without a fault."),
    ] = None,
    size: Annotated[
        int | None,
        typer.Option("--bytes", metavar="N", min=1, help="mutations, boards: number of bytes."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="WORD", help="processors, bundle: only those with this word. Repeatable."),
    ] = None,
    install: Annotated[
        bool | None,
        typer.Option("--install", help="processors, container, bundle: let apt-get install what it takes."),
    ] = None,
    json: Json = False,
) -> None:
    """Check what docs/how-true.md claims.

    Checks are small unless --full is given. The exit code is 1 if a claim does not hold. --json prints the
    figures of one claim; of several, an object with those of each.
    """
    from benchmarks.claims import verification
    from command_line.bench.options import given

    options = {
        "runs": runs, "seed": seed, "duration": duration, "robots": robots, "workers": workers, "data": data,
        "source": source, "against": against, "log": log, "cell": cell, "maps": maps, "goals": goals,
        "scenario": scenario, "strategy": strategy, "localisation": localisation, "navigation": navigation,
        "setting": setting, "trials": trials, "hours": hours, "size": size, "only": only, "install": install,
    }  # fmt: skip
    chosen = verification.chosen(claim or ())
    takers = {name: one.takes for name, one in verification.CHECKED.items()}
    settings = given(options, takers, [one.name for one in chosen] if claim else ())
    if listed:
        found = verification.listed()
    elif len(chosen) == 1:
        found = verification.verified_alone(chosen[0], settings, full=full)
    else:
        found = verification.verified(chosen, settings, full=full)
    raise typer.Exit(verification.told(found, json_output=json))
