"""`acrc study`: what is done about a study before its first run."""

from pathlib import Path
from typing import Annotated

import typer

from command_line.options import Json


def plan(
    a12: Annotated[
        float,
        typer.Option(metavar="A", min=0.0, max=1.0, help="Effect size to detect (Vargha and Delaney's A12)."),
    ] = 0.71,
    power: Annotated[
        float, typer.Option(metavar="P", min=0.5, max=0.999, help="Probability of detecting it.")
    ] = 0.9,
    correlation: Annotated[
        float,
        typer.Option(metavar="R", min=-0.99, max=0.99, help="Correlation of two runs with the same seed."),
    ] = 0.0,
    comparisons: Annotated[
        int,
        typer.Option(metavar="N", min=1, max=1000, help="Number of declared comparisons that share the 5 %."),
    ] = 1,
    pilot: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Draw campaigns from this one, and judge them."),
    ] = None,
    metric: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Metric of the pilot, as for compare.  [default: the study's]"),
    ] = None,
    json: Json = False,
) -> None:
    """Compute how many pairs of runs an effect needs."""
    from command_line.experiments import plan_command

    if pilot is not None:
        plan_command.run_pilot(pilot, metric, power, comparisons, json=json)
    else:
        plan_command.run(a12, power, correlation, comparisons, json=json)


def freeze(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY.toml", show_default=False, help="What is to be compared.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="File for the plan.  [default: STUDY.frozen.json beside it]"),
    ] = None,
    until_decided: Annotated[
        bool,
        typer.Option("--until-decided", help="Plan interim looks, as the campaign's --until-decided."),
    ] = False,
    json: Json = False,
) -> None:
    """Freeze a study before its first run, and print the plan's SHA-256.

    The plan has the commit, margins, primary comparisons, number of seeds, stop rule, and a hash of every
    file that the study reads. Campaigns are held against it, and acrc compare says what was declared before.
    """
    from command_line.experiments import freeze_command

    freeze_command.run(study, out, until_decided=until_decided, json=json)


app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Plan a study, and freeze the plan.",
)
for _command in (plan, freeze):
    app.command()(_command)
