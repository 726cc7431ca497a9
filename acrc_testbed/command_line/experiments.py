"""Options of the commands campaign, compare, causes, gap, report, bundle and study."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final

from rich.table import Table

from acrc_testbed.command_line import shared_options
from acrc_testbed.command_line.shared_options import (
    CampaignFolder,
    Json,
    Modules,
    Robots,
    Setting,
    Trust,
    answer,
    argument,
    check_absent,
    command_group,
    flag,
    option,
    permission,
)
from acrc_testbed.explanation.time_spent import Cause, TimeSpent
from actors.runtime import regular_file
from actors.runtime.errors import printable


def campaign(
    study: Annotated[
        Path | None,
        argument("STUDY.toml", "Study to run; a scenario is used as --scenario.", show_default=False),
    ] = None,
    scenario: Annotated[
        Path | None, option("FILE", "Without a study: run this scenario.  [default: scenarios/chapter.toml]")
    ] = None,
    strategies: Annotated[
        str | None,
        option(
            "NAMES",
            "Without a study: compare these strategies.  [default: none,chapter]",
            autocompletion=shared_options.strategies,
        ),
    ] = None,
    seeds: Annotated[int | None, option("N", "Use seeds 1 to N.  [default: 10]", min=1, max=100_000)] = None,
    robots: Robots = None,
    duration: Annotated[str | None, option("S", "Simulate at most this many seconds per run.")] = None,
    setting: Setting = None,
    tuning: Annotated[bool, flag("Use seeds reserved for choosing settings.", "--tuning")] = False,
    out: Annotated[
        Path | None,
        option("DIR", "Write results to this folder, or resume there.  [default: in campaigns/]"),
    ] = None,
    preset: Annotated[
        str | None, option("NAME", "Run a shipped study: chapter, the chapter's experiment.")
    ] = None,
    plan: Annotated[
        Path | None,
        option("FILE", "Check against this frozen plan.  [default: STUDY.frozen.json if it exists]"),
    ] = None,
    until_decided: Annotated[
        bool,
        flag("Stop at the interim look that decides the primary comparisons.", "--until-decided"),
    ] = False,
    check_every: Annotated[
        int,
        option(
            "N",
            "Repeat the first and every Nth run of each strategy as processes to check it; 0: none.",
            min=0,
        ),
    ] = 20,
    isolate: Annotated[
        bool, flag("Run every strategy in a sandbox: for code that you have not read.", "--isolate")
    ] = False,
    on: Annotated[
        str | None,
        option("ADDRESS", "Run on a Dask cluster: tls://HOST:PORT.  [default: on this computer]"),
    ] = None,
    jobs: Annotated[int, option("N", "Use this many parallel runs; 0: one per core.", min=0, max=1024)] = 0,
    modules: Modules = None,
    trust: Trust = False,
    json: Json = False,
) -> None:
    """Run strategies with the same seeds and compare them.

    Each strategy runs in each variant of the scenario. An interrupted campaign is resumed.
    """
    from acrc_testbed.command_line import campaign_commands
    from acrc_testbed.experiments.campaign import CampaignOptions
    from acrc_testbed.experiments.trial_settings import StudyOptions

    study_options = StudyOptions(
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
    permit = permission(modules, trust=trust)
    campaign_commands.campaign(
        study_options, out, options, permit, plan=plan, until_decided=until_decided, json_output=json
    )


def causes(
    folder: Annotated[Path, argument("OUT", "Folder of a simulated run.", show_default=False)],
    json: Json = False,
) -> None:
    """Break down the robots' time by cause.

    Causes are deadlock, blocked by dead robot, lost, and others; docs/concepts.md defines them. Also print
    the longest blockages, the effects of decisions, and for whom others waited.
    """
    from acrc_testbed.explanation.time_accounting import account_time

    spent = account_time(folder)
    tables = (
        table
        for table in (_time_table(spent), _blockage_table(spent), _decision_table(spent))
        if table.row_count
    )
    answer((*tables, *_finding_sentences(spent)), spent, json=json)


def compare(
    folder: CampaignFolder,
    metric: Annotated[
        str | None,
        option(
            "NAME",
            "Compare only this metric: one of the task, such as places; lexicographic, contacts, "
            "people_contacts, people_contact_s, radio, driven, energy; one of the study; or outcome.NAME, a "
            "number that strategies report.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Test and estimate the differences between strategies."""
    from acrc_testbed.command_line import campaign_commands

    campaign_commands.compare(folder, metric, json_output=json)


def gap(
    field: Annotated[Path, argument("FIELD", "Folder of a field trial, as for `acrc fleet collect`.")],
    run: Annotated[Path, argument("RUN", "Folder of a simulated run of the same scenario.")],
    json: Json = False,
) -> None:
    """Compare a field trial with a simulated run.

    Print how far they lie apart, and values of the scenario's and robot model's keys that bring the
    simulation nearer.
    """
    from acrc_testbed.experiments.gap_report import compare_field
    from actors.console import create_console

    with create_console(stderr=True, soft_wrap=False).status("reading"):
        found = compare_field(field, run)
    measured = Table("quantity", "field", "simulated", "difference, 95 % interval", title="Gap")
    for one in found.quantities:
        difference = _value_text(one.difference, one.interval) if one.interval else ""
        name = f"{one.name}, {one.unit}".rstrip(", ")
        measured.add_row(name, _value_text(one.field), _value_text(one.simulated), difference)
    fits = Table("key", "simulated", "fitted, 95 % interval", "p", "result", title="Keys")
    for fit in found.keys:
        p = "" if fit.p is None else f"{fit.p:.2g}"
        values = _value_text(fit.simulated), _value_text(fit.fitted, fit.interval)
        fits.add_row(fit.key, *values, p, fit.verdict)
    answer((measured, fits, *found.notes), found, json=json)


def _value_text(value: float, interval: list[float] | None = None) -> str:
    """Return the value as text, with its interval if that is known."""
    within = " ({:.3g} to {:.3g})".format(*interval) if interval else ""
    return "too little data" if math.isnan(value) else f"{value:.3g}{within}"


def report(
    folders: Annotated[
        list[Path],
        argument("DIR…", "Folder of a campaign, of a run, or of `acrc fleet collect`.", show_default=False),
    ],
    out: Annotated[
        Path | None, option("DIR", "Write the report to this folder.  [default: report in the first DIR]")
    ] = None,
    json: Json = False,
) -> None:
    """Write an HTML report of runs, with its data."""
    from acrc_testbed.experiments.report import report_page
    from deploy.run import out_folder

    target = out or folders[0] / "report"
    with out_folder.convert_write_errors(target):
        page = report_page.write(folders, out or regular_file.check_no_link(target))
    answer([f"written to {page}, with pictures and tables"], {"page": page}, json=json)


def bundle(
    folder: CampaignFolder,
    out: Annotated[
        Path | None, option("FILE.zip", "Write the bundle to this file.  [default: DIR.zip]")
    ] = None,
    author: Annotated[list[str] | None, option("NAME", "Cite this author. Repeatable.", "--author")] = None,
    json: Json = False,
) -> None:
    """Pack a campaign so that others can check and repeat it."""
    from acrc_testbed.experiments.report.campaign_bundle import make_bundle
    from deploy.run import out_folder

    target, authors = out or folder.resolve().parent / f"{folder.resolve().name}.zip", author or []
    with out_folder.convert_write_errors(target):
        has_software = make_bundle(folder, target, authors)
    lines = [f"written to {target}; unpack it and run ./reproduce.sh to repeat the runs"]
    if not has_software:
        lines.append("the software is not included: it has uncommitted changes, or its commit is missing")
    if not authors:
        lines.append("CITATION.cff has no author; add --author NAME")
    answer(lines, {"file": target, "has_software": has_software, "authors": authors}, json=json)


def plan(
    a12: Annotated[
        float | None,
        option("A", "Detect this effect size (Vargha and Delaney's A12).  [default: 0.71]", min=0.0, max=1.0),
    ] = None,
    power: Annotated[float, option("P", "Detect it with this probability.", min=0.5, max=0.999)] = 0.9,
    correlation: Annotated[
        float | None,
        option("R", "Assume this correlation of runs with the same seed.  [default: 0]", min=-0.99, max=0.99),
    ] = None,
    comparisons: Annotated[
        int | None,
        option("N", "Share the 5 % among this many declared comparisons.  [default: 1]", min=1, max=1000),
    ] = None,
    pilot: Annotated[Path | None, option("DIR", "Estimate power by resampling this pilot campaign.")] = None,
    metric: Annotated[
        str | None, option("NAME", "Use this metric of the pilot, as for compare.  [default: the study's]")
    ] = None,
    difference: Annotated[
        str | None,
        option("PERCENT", "With --pilot: detect a difference of this part of the second strategy's mean."),
    ] = None,
    json: Json = False,
) -> None:
    """Compute how many pairs of runs an effect requires."""
    from acrc_testbed.command_line import campaign_commands

    if pilot is not None:
        check_absent(
            "cannot be combined with --pilot",
            {"--a12": a12, "--correlation": correlation, "--comparisons": comparisons},
        )
        campaign_commands.plan_from_pilot(pilot, metric, power, difference, json=json)
    else:
        check_absent("needs --pilot", {"--metric": metric, "--difference": difference})
        effect = 0.71 if a12 is None else a12
        campaign_commands.plan(effect, power, correlation or 0.0, comparisons or 1, json=json)


def freeze(
    study: Annotated[Path, argument("STUDY.toml", "Study to freeze.", show_default=False)],
    out: Annotated[
        Path | None, option("FILE", "Write the plan to this file.  [default: STUDY.frozen.json]")
    ] = None,
    until_decided: Annotated[
        bool, flag("Plan interim looks for `acrc campaign --until-decided`.", "--until-decided")
    ] = False,
    json: Json = False,
) -> None:
    """Freeze a study before its first run, and print the plan's SHA-256.

    The plan contains the commit, margins, primary comparisons, number of seeds, stop rule, and a hash of each
    file that the study reads. Campaigns are checked against it, and acrc compare names what was declared.
    """
    from acrc_testbed.command_line import campaign_commands

    campaign_commands.freeze(study, out, until_decided=until_decided, json=json)


study = command_group("Plan a study, and freeze the plan.", plan, freeze)


_MAX_ROWS: Final = 20
"""Maximum number of blockages and decisions shown; --json has all."""


def _time_table(spent: TimeSpent) -> Table:
    """Return a table with a row per cause that occurred, s."""
    table = Table("time, s", *spent.robots, "all", title="Time by cause")
    for cause in dict.fromkeys(name for each in spent.robots.values() for name in each):
        durations = [each[cause] for each in spent.robots.values()]
        if any(durations):
            table.add_row(printable(cause), *(f"{s:.1f}" for s in (*durations, sum(durations))))
    totals = [sum(each.values()) for each in spent.robots.values()]
    table.add_row("total", *(f"{s:.1f}" for s in (*totals, sum(totals))))
    return table


def _blockage_table(spent: TimeSpent) -> Table:
    table = Table("from, s", "to, s", "robots", "x, y, m", "location", "cause", title="Longest blockages")
    longest = sorted(spent.blockings, key=lambda one: one.begin_s - one.end_s)[:_MAX_ROWS]
    for one in sorted(longest, key=lambda one: one.begin_s):
        end = f"{one.end_s:.1f}" + (" (end of run)" if one.at_end else "")
        where = f"{one.x:.1f}, {one.y:.1f}"
        table.add_row(f"{one.begin_s:.1f}", end, ", ".join(one.robots), where, one.place, one.cause)
    return table


def _decision_table(spent: TimeSpent) -> Table:
    table = Table(
        "time, s", "robot", "decision", "made by", "data from", "outcome", "moved after", title="Decisions"
    )
    for one in spent.decisions[:_MAX_ROWS]:
        known = ", ".join(
            f"{each.source}, {each.age_s:.1f} s old" if each.source != one.robot else "itself"
            for each in one.knowledge
        )
        free = "" if one.free_after_s is None else f"{one.free_after_s:.1f} s"
        by = one.trigger.partition(".")[0 if one.trigger.endswith(".at_member") else 2]
        table.add_row(f"{one.instant_s:.1f}", one.robot, one.words, by, known, one.outcome, free)
    return table


def _finding_sentences(spent: TimeSpent) -> Iterator[str]:
    hidden = [max(len(each) - _MAX_ROWS, 0) for each in (spent.blockings, spent.decisions)]
    if any(hidden):
        yield f"not shown: {hidden[0]} blockages, {hidden[1]} decisions; --json has them"
    if spent.decisions_left_out:
        yield f"decisions not recorded by robots: {spent.decisions_left_out}"
    if spent.decisions:
        yield (
            "outcome: what happened next; superseded: still blocked at the robot's next decision; "
            "moved after: time until it was no longer blocked"
        )
    if any(each[Cause.NO_PROGRESS.value] for each in spent.robots.values()):
        yield (
            "no progress: the robot stands for none of the other reasons, such as at a wall or robot that "
            "navigation does not get past; docs/concepts.md defines all causes"
        )
    for blame in spent.blames:
        yield f"others waited {blame.seconds:.1f} s for {blame.robot} (cause: {blame.cause})"
    if (deadlocks := spent.deadlocks) is not None and deadlocks.pairs:
        yield (
            f"deadlocks of two robots of 10 s or longer: {deadlocks.pairs}; "
            f"resolved before the end of the run: {deadlocks.came_free}"
        )
    if (score := spent.diagnosis) is not None and (score.spells or score.false_alarms):
        precision, recall = (
            "none" if share is None else f"{share:.0%}" for share in (score.precision, score.recall)
        )
        delay = "" if score.delay_s is None else f" after {score.delay_s:.1f} s (median)"
        yield (
            f"Blockage detection by the robots: precision {precision}, recall {recall} of the time; "
            f"{score.noticed} of {score.spells} blockages detected{delay}; false alarms: {score.false_alarms}"
        )
    for finding in spent.findings:
        yield f"{finding.name}: {finding.says}"
