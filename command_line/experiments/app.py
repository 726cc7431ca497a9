"""The commands of experiments, each by itself."""

from pathlib import Path
from typing import Annotated

import typer

from command_line import completion
from command_line.options import Json, Modules, Robots, Setting, Trust


def campaign(
    study: Annotated[
        Path | None,
        typer.Argument(metavar="STUDY.toml", show_default=False, help="What is to be found out."),
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Without a study: the scenario.  [default: scenarios/chapter.toml]"
        ),
    ] = None,
    strategies: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Without a study: as in none,chapter.  [default: none,chapter]",
            autocompletion=completion.strategies,
        ),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(metavar="N", min=1, max=100_000, help="Seeds 1 to N.  [default: 10]")
    ] = None,
    robots: Robots = None,
    duration: Annotated[str | None, typer.Option(metavar="S", help="Simulated seconds of each run.")] = None,
    setting: Setting = None,
    tuning: Annotated[
        bool, typer.Option("--tuning", help="Seeds for choosing settings, which no test ever has.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Where the results go; one that was begun goes on.  [default: in campaigns/]"
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="A study that is shipped: chapter, the chapter's experiment."),
    ] = None,
    until_decided: Annotated[
        bool,
        typer.Option(
            "--until-decided",
            help="Stop as soon as the primary comparisons are decided, by looks planned ahead.",
        ),
    ] = False,
    check_every: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=0,
            help="Repeat one run in N of each strategy, drawn at the end, and as many odd ones; 0: none.",
        ),
    ] = 20,
    isolate: Annotated[
        bool,
        typer.Option(
            "--isolate", help="Make every run as isolated processes: for strategies that you have not read."
        ),
    ] = False,
    on: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Run them on a Dask cluster: tls://HOST:PORT.  [default: here]"),
    ] = None,
    jobs: Annotated[
        int, typer.Option(metavar="N", min=0, max=1024, help="Runs at once; 0: one per core.")
    ] = 0,
    modules: Modules = None,
    trust: Trust = False,
    json: Json = False,
) -> None:
    """Run every strategy in every variant of a scenario with the same seeds; what is interrupted goes on."""
    from actors.robot.behaviour.foreign import permit_of
    from command_line.experiments import campaign_command
    from experiments.campaign.campaign import CampaignOptions
    from experiments.study.study_wishes import Wishes

    wishes = Wishes(
        study=study,
        preset=preset,
        scenario=scenario,
        strategies=strategies,
        seeds=seeds,
        robots=robots,
        duration=duration,
        settings=tuple(setting or ()),
        tuning=tuning,
        isolate=isolate,
    )
    options = CampaignOptions(jobs, check_every=check_every, on=on)
    permit = permit_of(modules, trust=trust)
    campaign_command.run(wishes, out, options, permit, until_decided=until_decided, json_output=json)


def causes(
    folder: Annotated[
        Path, typer.Argument(metavar="RUN_DIR", show_default=False, help="Of a simulated run.")
    ],
    json: Json = False,
) -> None:
    """Say where a run's time went: waiting at doors, wedged, lost; who blocked whom, what decisions did."""
    from command_line.experiments import causes_command

    causes_command.run(folder, json_output=json)


def compare(
    folder: Annotated[Path, typer.Argument(metavar="DIR", show_default=False, help="Of a campaign.")],
    metric: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Only this one: places, contacts, radio, driven, completion, settled, lexicographic.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Say which strategies differ, by how much, and how sure that is."""
    from command_line.experiments import compare_command

    compare_command.run(folder, metric, json_output=json)


def plan_study(
    a12: Annotated[
        float, typer.Option(metavar="A", min=0.0, max=1.0, help="How large an effect is to be seen.")
    ] = 0.71,
    power: Annotated[
        float, typer.Option(metavar="P", min=0.5, max=0.999, help="With which probability.")
    ] = 0.9,
    correlation: Annotated[
        float, typer.Option(metavar="R", min=-0.99, max=0.99, help="Of two runs with the same seed.")
    ] = 0.0,
    comparisons: Annotated[
        int, typer.Option(metavar="N", min=1, max=1000, help="So many tests share the 5 %.")
    ] = 1,
    pilot: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="A campaign whose runs say effect and correlation, in place of the options."
        ),
    ] = None,
    metric: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the pilot; as for compare.  [default: the study's]")
    ] = None,
) -> None:
    """Say how many pairs of runs an effect needs to be seen."""
    from command_line.experiments import plan_study_command

    if pilot is not None:
        plan_study_command.run_pilot(pilot, metric, power, comparisons)
    else:
        plan_study_command.run(a12, power, correlation, comparisons)


def report(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR…",
            show_default=False,
            help="Of a campaign, of one run, or of what acrc fleet collect gathered from real robots.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where the report goes.  [default: report in the first DIR]"),
    ] = None,
) -> None:
    """Write a page with pictures of what runs have shown, and the numbers behind each."""
    from command_line.experiments import report_command

    report_command.run(folders, out)


def bundle(
    folder: Annotated[Path, typer.Argument(metavar="DIR", show_default=False, help="Of a campaign.")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.zip", help="Where the bundle goes.  [default: DIR.zip beside it]"),
    ] = None,
    author: Annotated[
        list[str] | None, typer.Option("--author", metavar="NAME", help="Whom to cite. Repeatable.")
    ] = None,
) -> None:
    """Put a campaign into one file with all that others need to check it and to make it again."""
    from command_line.experiments import bundle_command

    bundle_command.run(folder, out, tuple(author or ()))
