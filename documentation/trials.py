"""How the commands on the pages are tried, where not simply as they stand: each with its reason, for review.

A command that is not named here is run by the tests as it stands, in a folder with what a clone has, after
those above it on its page.
"""

import shlex
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from documentation.markdown import Block


@dataclass(frozen=True)
class Reduced:
    """Takes long: the suite runs it with `words` behind it, the night as it stands."""

    words: str


@dataclass(frozen=True)
class Elsewhere:
    """Another test runs the same."""

    test: str
    """Its file, seen from the root of the repository."""


@dataclass(frozen=True)
class NotRun:
    """Cannot be run by a test; that its words are understood is tested all the same."""

    reason: str


Trial = Reduced | Elsewhere | NotRun

TRIALS: Final[MappingProxyType[str, Trial]] = MappingProxyType({
    "./acrc run": Reduced("--duration 5"),
    "./acrc run --seed 3": Reduced("--duration 5"),
    "./acrc run --robots 8 --seed 3 --duration 300": Reduced("--duration 5"),
    "./acrc run --bus memory --json": Reduced("--duration 5"),
    "./acrc run --strategy my_study.lease:behaviour": Reduced("--duration 5"),
    "./acrc run my_scenario.toml --speed 4 --view": Elsewhere("tests/swarm/test_onlooker.py"),
    "./acrc view runs/NAME": Elsewhere("tests/view/test_window.py"),
    "./acrc view runs/chapter": Elsewhere("tests/view/test_window.py"),
    "./acrc view runs/chapter --save chapter.rrd": Elsewhere("tests/view/test_drawn.py"),
    "./acrc view runs/chapter --screenshot view.png --at 172 --robot r3":
        Elsewhere("tests/view/test_window.py"),
    "./acrc run scenarios/head_on.toml --speed 4 --view --robot r2":
        Elsewhere("tests/swarm/test_onlooker.py"),
    "./acrc run scenarios/head_on.toml --speed 1 --out runs/mine": Elsewhere("tests/swarm/test_orders.py"),
    "./acrc run scenarios/head_on.toml --control": Elsewhere("tests/control/test_page.py"),
    "./acrc run scenarios/head_on.toml --strategy my_study.lease:behaviour --debug r2":
        Elsewhere("tests/debugging/test_debug.py"),
    "./acrc run --from runs/seen@5 --out runs/same": Elsewhere("tests/branches/test_branching.py"),
    "./acrc run --from runs/seen@5 --strategy none --out runs/without":
        Elsewhere("tests/branches/test_branching.py"),
    "./acrc run --from runs/seen@5 --event \"kill r2 at 8\" --event \"jam 12 9 5 2\" --out runs/branch":
        Elsewhere("tests/branches/test_branching.py"),
    "./acrc order runs/NAME freeze r2": Elsewhere("tests/swarm/test_orders.py"),
    "./acrc order runs/mine freeze r2": Elsewhere("tests/swarm/test_orders.py"),
    "./acrc order runs/mine thaw r2": Elsewhere("tests/swarm/test_orders.py"),
    "./acrc order runs/mine stop": Elsewhere("tests/swarm/test_orders.py"),
    "./acrc run scenarios/head_on.toml --strategy examples.courteous:behaviour --check":
        Reduced("--duration 5"),
    "./acrc run --hardware-in-the-loop": Elsewhere("tests/onboard/test_hardware_in_the_loop.py"),
    "./acrc run scenarios/head_on.toml --hardware-in-the-loop":
        Elsewhere("tests/onboard/test_hardware_in_the_loop.py"),
    "./acrc fleet onboard fleet.toml --robot r2": NotRun("wants a TurtleBot, and goes on until Ctrl-C"),
    "./acrc test": NotRun("is what runs this"),
    "./acrc add pandas": NotRun("wants a network, and changes the environment"),
    "./acrc bench failures": Reduced("--seeds 1 --robots 2 --duration 10"),
    "./acrc bench steps": Reduced("--robots 1 --duration 1"),
    "./acrc run scenarios/head_on.toml --out runs/seen": Reduced("--duration 20"),
    "./acrc run scenarios/head_on.toml --log r2 --out runs/said": Reduced("--duration 20"),
    "./acrc bench navigation --log cycles.zip --map maps/corridor.yaml --robots 4 --seed 7":
        Reduced("--goals 8"),
    "./acrc scenario actors/models/omnibox.toml --png omnibox.png":
        Elsewhere("tests/pictures/test_scenario.py"),
    "./acrc view runs/chapter --html --movie run.gif --speed 40":
        Elsewhere("tests/pictures/test_pictures.py"),
    "./acrc view runs/branch --beside runs/without --png": Elsewhere("tests/pictures/test_pictures.py"),
    "./acrc view runs/branch --beside runs/without --save beside.rrd": Elsewhere("tests/view/test_drawn.py"),
    "./acrc run scenarios/head_on.toml --strategy chapter --out runs/tables":
        Elsewhere("tests/recordings/test_export.py"),
    "./acrc export runs/tables --parquet": Elsewhere("tests/recordings/test_export.py"),
    "./acrc demo": Elsewhere("tests/pictures/test_pictures.py"),
    "./acrc run scenarios/chapter.toml --seed 42 --out runs/chapter": Reduced("--duration 5"),
    "./acrc replay runs/NAME --robot r2 --from 40 --pdb": Elsewhere("tests/replay/test_replay.py"),
    "./acrc replay runs/seen --robot r2 --from 15 --pdb": Elsewhere("tests/replay/test_replay.py"),
    "./acrc replay runs/seen --robot r2 --strategy random": Elsewhere("tests/replay/test_replay.py"),
    "./acrc campaign --preset chapter": Elsewhere("tests/experiments/test_campaign_command.py"),
    "./acrc campaign --preset chapter --out campaigns/fig710":
        Elsewhere("tests/experiments/test_campaign_command.py"),
    "./acrc report campaigns/four campaigns/eight --out report":
        Elsewhere("tests/experiments/report/test_report.py"),
    "./acrc report runs/2026-11-22 trials/friday --out report":
        Elsewhere("tests/experiments/report/test_cases.py"),
    "./acrc bundle campaigns/chapter --author \"Ada Lovelace\"":
        Elsewhere("tests/experiments/report/test_bundle.py"),
    "./acrc causes RUN_DIR": Elsewhere("tests/experiments/test_accounting.py"),
    "./acrc campaign study.toml --tuning --seeds 10 --out campaigns/pilot":
        Elsewhere("tests/experiments/test_campaign_command.py"),
    "./acrc plan-study --pilot campaigns/pilot": Elsewhere("tests/experiments/test_pilot.py"),
    "./acrc campaign study.toml --seeds 60 --until-decided": Elsewhere("tests/experiments/test_decision.py"),
    "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 365 -subj /CN=cluster "
    "-keyout cluster.key -out cluster.pem":
        Elsewhere("tests/experiments/test_cluster.py"),
    ".venv/bin/python -m distributed.cli.dask_scheduler --protocol tls --no-dashboard":
        Elsewhere("tests/experiments/test_cluster.py"),
    ".venv/bin/python -m distributed.cli.dask_worker tls://HOST:8786 --nthreads 1 --no-dashboard":
        Elsewhere("tests/experiments/test_cluster.py"),
    "./acrc campaign study.toml --on tls://HOST:8786": Elsewhere("tests/experiments/test_cluster.py"),
    "./acrc campaign studies/drawn_places.toml --out campaigns/drawn":
        NotRun("makes 240 runs; a test reads the study"),
    "./acrc campaign studies/all_strategies.toml --out campaigns/all --check-every 0":
        NotRun("makes 75 runs; a test reads the study"),
    "./acrc compare campaigns/all": Elsewhere("tests/experiments/test_comparison.py"),
    "./acrc compare campaigns/drawn": Elsewhere("tests/experiments/test_comparison.py"),
    "./acrc report campaigns/drawn": Elsewhere("tests/experiments/report/test_report.py"),
    "./acrc campaign --strategies none,chapter --seeds 40 --out campaigns/chapter":
        Reduced("--seeds 2 --duration 2"),
    "./acrc bench localisation --log course.zip --cell 'tracking/*/360/kobuki/4/*' --seed 7":
        Reduced("--duration 20"),
    "./acrc bench localisation --from course.zip --runs 20": Reduced("--runs 1"),
    "./acrc bench localisation --from logs/ --against theirs.json --runs 10": Reduced("--runs 1"),
    "./acrc bench relays --seeds 6 --seed 11 --below -75 --below -80 --robots 4 --robots 10 --robots 20 "
    "--duration 40":
        Elsewhere("tests/swarm_bench/test_relays.py"),
    "./acrc bench relays --seeds 6 --seed 11 --below -75 --below -80 --robots 50 --duration 30":
        Elsewhere("tests/swarm_bench/test_relays.py"),
    "./acrc bench relays --seeds 6 --seed 11 --below -75 --below -80 --robots 100 --duration 20":
        Elsewhere("tests/swarm_bench/test_relays.py"),
})  # fmt: skip
"""By the command as it stands on a page, without what is said behind `#`."""

PAGES: Final[MappingProxyType[tuple[str, str], str]] = MappingProxyType({
    ("docs/tutorial.md", "sh"): "tests/cli/test_tutorial.py",
    ("docs/tutorial.md", "python"): "tests/cli/test_tutorial.py",
    ("docs/deeco.md", "python"): "tests/deeco/test_docs.py",
    ("docs/tables.md", "python"): "tests/recordings/test_export.py",
    ("docs/experiments.md", "yaml"): "tests/experiments/test_cluster.py",
    ("docs/localisation-log.md", "python"): "tests/localisation_bench/test_log.py",
    ("docs/navigation-log.md", "python"): "tests/navigation_bench/test_navigation_log.py",
})  # fmt: skip
"""Pages whose blocks of a language have a test of their own, which shows that they do what the page says."""


def commands(block: Block) -> list[str]:
    """The commands of a block in `sh`, one a line, without what is said behind `#`."""
    text = block.text.replace("\\\n", " ")
    lines = (line.partition(" #")[0].strip() for line in text.splitlines())
    return [line for line in lines if shlex.split(line, comments=True)]


def reduced(command: str) -> str:
    """The command as the suite runs it."""
    trial = TRIALS.get(command)
    return f"{command} {trial.words}" if isinstance(trial, Reduced) else command


def mark(block: Block) -> str:
    """What stands below a block on the site: which of its commands are not tested as they stand; or ""."""
    said = []
    for command in commands(block):
        trial = TRIALS.get(command)
        if isinstance(trial, Reduced):
            said.append(f"Tested at reduced size: `{command} {trial.words}`.")
        elif isinstance(trial, NotRun):
            said.append(f"Not run by the tests: it {trial.reason}.")
    return " ".join(said)
