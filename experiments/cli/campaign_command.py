"""`acrc campaign`: the study that the words mean, its progress, and what has come of it."""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from deploy.processes.signals import Interrupted
from deploy.repository import REPOSITORY
from deploy.scenario.scenario_file import Overrides, load_scenario, settings
from deploy.usage import OptionError
from experiments.campaign import campaign, store
from experiments.campaign.campaign import CampaignOptions
from experiments.study.study import Study
from experiments.study.study_file import load_study

_SCENARIO: Final = REPOSITORY / "scenarios" / "chapter.toml"
_STRATEGIES: Final = ("none", "chapter")


@dataclass(frozen=True)
class Wishes:
    """The command line's own words about the study."""

    scenario: Path | None = None
    strategies: str | None = None
    seeds: int | None = None
    robots: str | None = None
    duration: str | None = None
    settings: tuple[str, ...] = ()
    tuning: bool = False


def run(path: Path | None, wishes: Wishes, out: Path | None, jobs: int, *, json_output: bool) -> None:
    """Carry the study out, and say how it stands."""
    study = study_of(path, wishes)
    check(study)
    folder = out or Path("campaigns", study.name + ("-tuning" if study.tuning else ""))
    kept = store.create(folder.absolute(), study)
    try:
        progress = _carried_out(kept, CampaignOptions(jobs), quiet=json_output)
    except Interrupted as interrupt:
        told = f"acrc: ended from outside; the same command goes on from what is in {folder}"
        Console(stderr=True, soft_wrap=True, highlight=False).print(told)
        raise typer.Exit(interrupt.exit_code) from None
    if json_output:
        sys.stdout.write(json.dumps({"out": str(folder), **msgspec.to_builtins(progress)}) + "\n")
        return
    console = Console(soft_wrap=True, highlight=False)
    for line in _causes(kept):
        console.print(line)
    console.print(
        f"{progress.done} of {progress.total} runs, {progress.failed} failed, in {folder}; "
        f"acrc compare {folder} says what they show"
    )


def study_of(path: Path | None, wishes: Wishes) -> Study:
    """The study in the file, or the one that the command line describes, with its wishes laid over."""
    own: list[tuple[str, Any]] = list(settings(wishes.settings))
    for key, text in (("robots.count", wishes.robots), ("run.duration", wishes.duration)):
        if text is not None:
            own += settings((f"{key}={text}",))
    if path is not None:
        if wishes.scenario is not None or wishes.strategies is not None:
            raise OptionError(
                "--scenario and --strategies: the study says so; must stand without a STUDY.toml"
            )
        study = load_study(path, tuning=wishes.tuning)
        return msgspec.structs.replace(
            study, settings=(*study.settings, *own), seeds=wishes.seeds or study.seeds
        )
    scenario = wishes.scenario or _SCENARIO
    named = tuple(name for name in (wishes.strategies or ",".join(_STRATEGIES)).split(",") if name)
    return Study(
        name=scenario.stem,
        scenario=str(scenario.resolve()),
        strategies=tuple(dict.fromkeys(named)),
        seeds=wishes.seeds or 10,
        tuning=wishes.tuning,
        settings=tuple(own),
    )


def check(study: Study) -> None:
    """Whatever every trial would stumble over is said before the first: scenario, keys, strategies."""
    from cleaning.strategies import entry

    for variant in study.variants():
        for strategy in study.strategies:
            overrides = Overrides(strategy=strategy, settings=(*study.settings, *variant))
            load_scenario(Path(study.scenario), overrides)
            entry(strategy)


def _carried_out(kept: store.Store, options: CampaignOptions, *, quiet: bool) -> campaign.Progress:
    bar = Progress(
        TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"),
        console=Console(stderr=True), disable=quiet,
    )  # fmt: skip
    with bar:
        task = bar.add_task("runs", total=None, left="")

        def follow(progress: campaign.Progress) -> None:
            left = "" if progress.left_s is None else f"about {_span(progress.left_s)} to go"
            failed = f", {progress.failed} failed" if progress.failed else ""
            bar.update(task, total=progress.total, completed=progress.done, left=left + failed)

        return campaign.carry_out(kept, options, follow)


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def _causes(kept: store.Store) -> list[str]:
    """Why runs failed, a line for each cause."""
    causes: dict[str, list[str]] = {}
    for record in kept.records():
        if record.failure is not None:
            causes.setdefault(record.failure, []).append(f"{record.strategy} with seed {record.seed}")
    return [f"failed: {cause} ({len(who)} runs, first {who[0]})" for cause, who in causes.items()]
