"""Commands that make campaigns, and files of them: campaign, study freeze, report, bundle."""

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import msgspec
import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from acrc_testbed.command_line.options import answer
from acrc_testbed.experiments.campaign import campaign as campaigns
from acrc_testbed.experiments.campaign import plan_taken, results_table, store
from acrc_testbed.experiments.campaign.campaign import CampaignOptions
from acrc_testbed.experiments.campaign.plan_taken import declared
from acrc_testbed.experiments.campaign.store import differing, protection
from acrc_testbed.experiments.comparison import decision
from acrc_testbed.experiments.comparison.coincidence import coincidences
from acrc_testbed.experiments.comparison.coincidence import told as coincidences_told
from acrc_testbed.experiments.comparison.family import foreseen, step_names
from acrc_testbed.experiments.comparison.judgement import summaries
from acrc_testbed.experiments.statistics.paired_tests import LEAST_PAIRS
from acrc_testbed.experiments.study import frozen_plan
from acrc_testbed.experiments.study.study import load_study
from acrc_testbed.experiments.study.study_wishes import StudyWishes, check, path_of, study_of, understood
from acrc_testbed.results.seal import seal
from actors.console import screen
from actors.installation.usage import typed
from actors.installation.version import software
from actors.processes.signals import Interrupted
from actors.robot.behaviour.foreign import Permit
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import choose
from deploy.clusters.address import plain
from deploy.run import out_folder
from deploy.run.progress import lines


def campaign(
    wishes: StudyWishes,
    out: Path | None,
    options: CampaignOptions,
    permit: Permit,
    *,
    plan: Path | None,
    until_decided: bool,
    json_output: bool,
) -> None:
    """Carry the study out, and say how it stands. Exit code 1 if a repeated run gave another digest."""
    if options.on is not None:
        options = replace(options, on=plain(options.on))  # said before anything is written
    wishes, taken_for = understood(wishes)
    study = study_of(wishes)
    if study.isolated and options.on is None:
        choose(True)  # refused here, not run by run
    source = path_of(wishes)
    hints, modules = check(study, permit, source)
    plan_file = plan_taken.plan_of(plan, None if study.tuning else source)
    options = replace(options, modules=modules)
    folder = out or Path("campaigns", study.name + ("-tuning" if study.tuning else ""))
    kept = store.create(folder.absolute(), study)
    watch = decision.Watch(kept) if until_decided else None
    if watch is not None:
        kept.declare_looks()
    frozen = plan_taken.take_in(kept, plan_file, source, looks=until_decided)
    say = screen(stderr=True)
    least = LEAST_PAIRS if watch is None else watch.rules.least
    for line in [] if json_output else (*taken_for, *hints, *foreseen(study, least), *frozen):
        say.print(line)
    try:
        progress = _carried_out(kept, options, watch, quiet=json_output)
    except Interrupted as interrupt:
        say.print(f"acrc: ended from outside; the same command resumes from {folder}")
        raise typer.Exit(interrupt.exit_code) from None
    finally:
        results_table.write(kept)
        seal(kept.folder)
    different = differing(kept)
    if json_output:
        _print_json(kept, folder, progress)
    else:
        console = screen()
        for line in _lines(kept, folder, progress, watch):
            console.print(line)
    for line in different:
        say.print(f"acrc: {line}", style="bold red")
    if different:
        raise typer.Exit(1)


def _lines(
    kept: store.Store, folder: Path, progress: campaigns.CampaignProgress, watch: decision.Watch | None
) -> Iterator[str]:
    """What is said at the end."""
    yield from protection(kept)
    yield from _causes(kept)
    yield from summaries(kept.records())
    yield from coincidences_told(coincidences(kept.records()))
    if watch is not None:
        yield from decision.told(watch.looked_at(), watch.rules)
    yield (
        f"{progress.done} of {progress.total} runs, {progress.failed} failed, in {folder}, as tables in"
        f" results.csv and results.parquet; {typed('compare', folder)} says what they show"
    )


def _causes(kept: store.Store) -> list[str]:
    """Why runs failed, a line for each cause."""
    found: dict[str, list[str]] = {}
    for record in kept.records():
        if record.failure is not None:
            found.setdefault(record.failure, []).append(f"{record.strategy} with seed {record.seed}")
    return [f"failed: {cause} ({len(who)} runs, first {who[0]})" for cause, who in found.items()]


def _print_json(kept: store.Store, folder: Path, progress: campaigns.CampaignProgress) -> None:
    told = {
        "out": str(folder),
        **msgspec.to_builtins(progress),
        "protection": protection(kept),
        "differing": differing(kept),
        "checks": [msgspec.to_builtins(one) | {"agrees": one.agrees} for one in kept.checks()],
        "coincide": [msgspec.to_builtins(one) for one in coincidences(kept.records())],
    }
    sys.stdout.write(json.dumps(told) + "\n")


def _carried_out(
    kept: store.Store, options: CampaignOptions, watch: decision.Watch | None, *, quiet: bool
) -> campaigns.CampaignProgress:
    with shown(quiet=quiet) as follow:
        if watch is None:
            return campaigns.carry_out(kept, options, follow)
        return campaigns.carry_out(kept, options, follow, watch.enough)


@contextmanager
def shown(*, quiet: bool) -> Iterator[campaigns.OnProgress]:
    """Says on standard error how far the campaign is: by a bar at a terminal, else by a line now and then."""
    console = screen(stderr=True, soft_wrap=False)
    if quiet:
        yield lambda progress: None
        return
    if not console.is_terminal:
        say = lines(console)
        yield lambda progress: say(f"{progress.done} of {progress.total} runs{_stands(progress)}")
        return
    bar = Progress(
        TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[stands]}"),
        console=console,
    )  # fmt: skip
    with bar:
        task = bar.add_task("runs", total=None, stands="")
        yield lambda progress: bar.update(
            task, total=progress.total, completed=progress.done, stands=_stands(progress).removeprefix(", ")
        )


def _stands(progress: campaigns.CampaignProgress) -> str:
    """What there is to say beside how many runs have ended, each behind a comma."""
    failed = f", {progress.failed} failed" if progress.failed else ""
    decided = ", decided" if progress.enough else ""
    if not progress.left_s:
        return failed + decided
    checking = ", repeating some to check them" if progress.done == progress.total else ""
    return f"{failed}{decided}{checking}, about {_span(progress.left_s)} left"


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def freeze(study_file: Path, out: Path | None, *, until_decided: bool, json: bool) -> None:
    """Freeze the study beside its file, or where it is asked for. Raises AcrcError over a file."""
    target = out or study_file.with_suffix(frozen_plan.SUFFIX)
    if target.exists():
        raise AcrcError(f"{target}: is there already; must be another file, for what is frozen stays")
    study = load_study(study_file)
    step_names(study)
    looks = decision.rules_for(study).differ.looks if until_decided else ()
    content = frozen_plan.freeze(study, software(), looks)
    with out_folder.writing(target):
        regular_file.write(target, content)
    plan = frozen_plan.read(target)
    said = [
        f"Frozen {declared(plan)}",
        f"written to {target}; a hash proves no date: publish it before the first run to prove one",
    ]
    answer(said, {"file": target, "commit": plan.commit, "sha256": plan.sha256}, json=json)


def report(folders: Sequence[Path], out: Path | None, *, json: bool) -> None:
    """Write the report beside the first folder's content, or where it is asked for."""
    from acrc_testbed.experiments.report import report as reports  # draws with matplotlib

    target = out or folders[0] / "report"
    with out_folder.writing(target):
        page = reports.write(folders, out or regular_file.no_link(target))
    said = f"written to {page}, with its pictures and tables beside it"
    answer([said], {"page": page}, json=json)


def bundle(folder: Path, out: Path | None, authors: Sequence[str], *, json: bool) -> None:
    """Write the bundle beside the campaign's folder, or where it is asked for."""
    from acrc_testbed.experiments.bundle import bundle as bundles  # draws with matplotlib

    target = out or folder.resolve().parent / f"{folder.resolve().name}.zip"
    with out_folder.writing(target):
        has_software = bundles.make(folder, target, authors)
    said = [f"written to {target}; unpack it and call ./reproduce.sh to repeat the runs"]
    if not has_software:
        said.append("without the software: it was changed after its last commit, or that commit is gone")
    if not authors:
        said.append("its CITATION.cff names no author; give --author NAME")
    answer(said, {"file": target, "has_software": has_software, "authors": authors}, json=json)
