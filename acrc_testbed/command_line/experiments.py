"""Options of the commands on experiments: campaign, compare, causes, report, bundle, study."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.table import Table

from acrc_testbed.command_line import options
from acrc_testbed.command_line.options import (
    Json,
    Modules,
    Robots,
    Setting,
    Trust,
    answer,
    argument,
    flag,
    option,
)
from acrc_testbed.explanation.time_spent import Cause, TimeSpent


def campaign(
    study: Annotated[
        Path | None,
        argument(
            "STUDY.toml", "Study to run. A scenario here is the same as --scenario.", show_default=False
        ),
    ] = None,
    scenario: Annotated[
        Path | None, option("FILE", "Without a study: run this scenario.  [default: scenarios/chapter.toml]")
    ] = None,
    strategies: Annotated[
        str | None,
        option(
            "NAMES",
            "Without a study: compare these strategies.  [default: none,chapter]",
            autocompletion=options.strategies,
        ),
    ] = None,
    seeds: Annotated[int | None, option("N", "Use seeds 1 to N.  [default: 10]", min=1, max=100_000)] = None,
    robots: Robots = None,
    duration: Annotated[str | None, option("S", "Simulated seconds of each run.")] = None,
    setting: Setting = None,
    tuning: Annotated[bool, flag("Use other seeds than tests do, to choose settings.", "--tuning")] = False,
    out: Annotated[
        Path | None,
        option("DIR", "Folder for the results; an interrupted one is resumed.  [default: in campaigns/]"),
    ] = None,
    preset: Annotated[
        str | None, option("NAME", "Run a shipped study: chapter, the chapter's experiment.")
    ] = None,
    plan: Annotated[
        Path | None,
        option("FILE", "Hold it against this frozen plan.  [default: STUDY.frozen.json if there is one]"),
    ] = None,
    until_decided: Annotated[
        bool,
        flag("Stop once the primary comparisons are decided, at planned interim looks.", "--until-decided"),
    ] = False,
    check_every: Annotated[
        int,
        option(
            "N",
            "Repeat the first run of each strategy, and every Nth, as processes to check them; 0: none.",
            min=0,
        ),
    ] = 20,
    isolate: Annotated[
        bool, flag("Run every strategy in a sandbox: for strategies that you have not read.", "--isolate")
    ] = False,
    on: Annotated[
        str | None, option("ADDRESS", "Run on a Dask cluster: tls://HOST:PORT.  [default: here]")
    ] = None,
    jobs: Annotated[int, option("N", "Number of parallel runs; 0: one per core.", min=0, max=1024)] = 0,
    modules: Modules = None,
    trust: Trust = False,
    json: Json = False,
) -> None:
    """Run every strategy with the same seeds, and compare.

    It runs each strategy in each variant of a scenario. An interrupted campaign is resumed.
    """
    from acrc_testbed.command_line import campaigns
    from acrc_testbed.experiments.campaign import CampaignOptions
    from acrc_testbed.experiments.draws import StudyOptions
    from actors.robot.behaviour.code_permit import permit_of

    wishes = StudyOptions(
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
    campaigns.campaign(wishes, out, options, permit, plan=plan, until_decided=until_decided, json_output=json)


def causes(
    folder: Annotated[Path, argument("OUT", "A simulated run's folder.", show_default=False)],
    json: Json = False,
) -> None:
    """Say where the robots' time went, by cause.

    Causes are deadlock, blocked by dead robot, lost, and others; it also names who blocked whom, and what
    decisions changed.
    """
    from acrc_testbed.explanation.time_accounting import account_time

    spent = account_time(folder)
    tables = (table for table in (_times(spent), _blockings(spent), _decisions(spent)) if table.row_count)
    answer((*tables, *_sentences(spent)), spent, json=json)


def compare(
    folder: Annotated[Path, argument("DIR", "A campaign's folder.", show_default=False)],
    metric: Annotated[
        str | None,
        option(
            "NAME",
            "Compare only this: places, contacts, radio, driven, completion, settled, lexicographic; "
            "or outcome.NAME, a number that strategies report.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Say which strategies differ, by how much, how surely."""
    from acrc_testbed.command_line import campaigns

    campaigns.compare(folder, metric, json_output=json)


def report(
    folders: Annotated[
        list[Path],
        argument("DIR…", "Folder of a campaign, of a run, or of `acrc fleet collect`.", show_default=False),
    ],
    out: Annotated[
        Path | None, option("DIR", "Folder for the report.  [default: report in the first DIR]")
    ] = None,
    json: Json = False,
) -> None:
    """Write an HTML report of runs, with the data behind it."""
    from acrc_testbed.command_line import campaigns

    campaigns.report(folders, out, json=json)


def bundle(
    folder: Annotated[Path, argument("DIR", "A campaign's folder.", show_default=False)],
    out: Annotated[
        Path | None, option("FILE.zip", "File for the bundle.  [default: DIR.zip beside it]")
    ] = None,
    author: Annotated[list[str] | None, option("NAME", "Author to cite. Repeatable.", "--author")] = None,
    json: Json = False,
) -> None:
    """Pack a campaign so that others can check and repeat it."""
    from acrc_testbed.command_line import campaigns

    campaigns.bundle(folder, out, tuple(author or ()), json=json)


def plan(
    a12: Annotated[
        float, option("A", "Effect size to detect (Vargha and Delaney's A12).", min=0.0, max=1.0)
    ] = 0.71,
    power: Annotated[float, option("P", "Probability of detecting it.", min=0.5, max=0.999)] = 0.9,
    correlation: Annotated[
        float, option("R", "Correlation of two runs with the same seed.", min=-0.99, max=0.99)
    ] = 0.0,
    comparisons: Annotated[
        int, option("N", "Number of declared comparisons that share the 5 %.", min=1, max=1000)
    ] = 1,
    pilot: Annotated[Path | None, option("DIR", "Draw campaigns from this one, and judge them.")] = None,
    metric: Annotated[
        str | None, option("NAME", "Metric of the pilot, as for compare.  [default: the study's]")
    ] = None,
    json: Json = False,
) -> None:
    """Compute how many pairs of runs an effect needs."""
    from acrc_testbed.command_line import campaigns

    if pilot is not None:
        campaigns.plan_from_pilot(pilot, metric, power, comparisons, json=json)
    else:
        campaigns.plan(a12, power, correlation, comparisons, json=json)


def freeze(
    study: Annotated[Path, argument("STUDY.toml", "Study to freeze.", show_default=False)],
    out: Annotated[
        Path | None, option("FILE", "File for the plan.  [default: STUDY.frozen.json beside it]")
    ] = None,
    until_decided: Annotated[
        bool, flag("Plan interim looks, as the campaign's --until-decided.", "--until-decided")
    ] = False,
    json: Json = False,
) -> None:
    """Freeze a study before its first run, and print the plan's SHA-256.

    The plan has the commit, margins, primary comparisons, number of seeds, stop rule, and a hash of every
    file that the study reads. Campaigns are held against it, and acrc compare says what was declared before.
    """
    from acrc_testbed.command_line import campaigns

    campaigns.freeze(study, out, until_decided=until_decided, json=json)


study = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Plan a study, and freeze the plan.",
)
for _command in (plan, freeze):
    study.command()(_command)


_MOST: Final = 20
"""Blockings and decisions that are shown one by one; --json has all."""


def _times(spent: TimeSpent) -> Table:
    """A row for each cause that there was; s."""
    table = Table("s", *spent.robots, "all", title="Where the time went")
    for cause in Cause:
        lasted = [each[cause.value] for each in spent.robots.values()]
        if any(lasted):
            table.add_row(cause.value, *(f"{s:.1f}" for s in (*lasted, sum(lasted))))
    whole = [sum(each.values()) for each in spent.robots.values()]
    table.add_row("together", *(f"{s:.1f}" for s in (*whole, sum(whole))))
    return table


def _blockings(spent: TimeSpent) -> Table:
    table = Table("from", "to", "robots", "at", "place", "cause", title="The longest blockings")
    longest = sorted(spent.blockings, key=lambda one: one.begin_s - one.end_s)[:_MOST]
    for one in sorted(longest, key=lambda one: one.begin_s):
        end = f"{one.end_s:.1f}" + (" (the run's)" if one.at_end else "")
        where = f"{one.x:.1f}, {one.y:.1f}"
        table.add_row(f"{one.begin_s:.1f}", end, ", ".join(one.robots), where, one.place, one.cause)
    return table


def _decisions(spent: TimeSpent) -> Table:
    table = Table("at", "robot", "decided", "by", "knowing from", "outcome", "free after", title="Decisions")
    for one in spent.decisions[:_MOST]:
        known = ", ".join(f"{each.source} ({each.age_s:.1f} s old)" for each in one.knowledge)
        free = "" if one.free_after_s is None else f"{one.free_after_s:.1f} s"
        by = one.trigger.partition(".")[0 if one.trigger.endswith(".at_member") else 2]
        table.add_row(f"{one.instant_s:.1f}", one.robot, one.words, by, known, one.outcome, free)
    return table


def _sentences(spent: TimeSpent) -> Iterator[str]:
    hidden = [max(len(each) - _MOST, 0) for each in (spent.blockings, spent.decisions)]
    if any(hidden):
        yield f"not shown: {hidden[0]} blockings, {hidden[1]} decisions; --json has them"
    if spent.decisions_left_out:
        yield f"{spent.decisions_left_out} more decisions were not kept by the robots"
    for blame in spent.blames:
        yield f"at the end of the chain, {blame.robot}: {blame.seconds:.1f} s of others, {blame.cause}"
    if spent.deadlocks is not None and spent.deadlocks.pairs:
        yield f"pairs in a deadlock: {spent.deadlocks.pairs}, of which {spent.deadlocks.came_free} came free"
    if (score := spent.diagnosis) is not None:
        precision, recall = (
            "none" if share is None else f"{share:.0%}" for share in (score.precision, score.recall)
        )
        delay = "" if score.delay_s is None else f", {score.delay_s:.1f} s after it began (median)"
        yield (
            f"the robots' own word that they are blocked: right for {precision} of the time they say so, "
            f"said for {recall} of the time that they are; {score.noticed} of {score.spells} spells "
            f"noticed{delay}; {score.false_alarms} false alarms"
        )
    for finding in spent.findings:
        yield f"{finding.name}: {finding.says}"
