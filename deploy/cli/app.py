"""The command line. What a command needs is imported once it is known which one it is."""

import contextlib
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from actors.runtime.errors import AcrcError
from deploy.cli import streams
from deploy.cli.added import WithAdded
from deploy.cli.collect import collect
from deploy.cli.fleet import app as deploy
from deploy.cli.fleet import doctor
from deploy.cli.record import app as record
from deploy.development.checks import run_checks
from deploy.development.suite import run_suite
from deploy.repository import REPOSITORY
from deploy.usage import OptionError

app = typer.Typer(
    name="acrc",
    cls=WithAdded,
    help="A testbed for self-adaptation: cleaning robots that can talk by radio only.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(record, name="record", help="Check and replay what a run has recorded.")
app.add_typer(deploy, name="deploy", help="Make keys for a fleet, and units for a robot's computer.")
app.command()(doctor)
app.command()(collect)
_PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}


def main() -> None:
    """Run the command line; an AcrcError is a line on standard error and exit code 1, or 2 for an option."""
    streams.settle()
    try:
        app(prog_name="acrc")
    except AcrcError as error:
        Console(stderr=True, soft_wrap=True).print(f"acrc: {error}", markup=False, highlight=False)
        sys.exit(2 if isinstance(error, OptionError) else 1)


@app.command()
def run(
    scenario: Annotated[
        Path | None,
        typer.Argument(metavar="SCENARIO.toml", help="What to run.  [default: scenarios/corridor.toml]"),
    ] = None,
    robots: Annotated[str | None, typer.Option(metavar="N", help="How many robots.")] = None,
    seed: Annotated[
        str | None, typer.Option(metavar="N", help="From which all that is random follows.")
    ] = None,
    duration: Annotated[str | None, typer.Option(metavar="S", help="Simulated seconds.")] = None,
    step: Annotated[str | None, typer.Option(metavar="MS", help="Length of a step, 10 to 100 ms.")] = None,
    strategy: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What robots do about being stuck: a name that `acrc strategies` lists, or module:function. "
            "Settings of another one in the scenario are left out.",
        ),
    ] = None,
    speed: Annotated[str, typer.Option(metavar="X", help="Simulated seconds per second, or max.")] = "max",
    bus: Annotated[
        str, typer.Option(metavar="zenoh|memory", help="A process per robot, or all of them in one.")
    ] = "zenoh",
    spawn: Annotated[
        str, typer.Option(metavar="forkserver|exec", help="How processes are started.")
    ] = "forkserver",
    isolate: Annotated[
        bool | None,
        typer.Option(
            "--isolate/--no-isolate",
            help="Shut each robot's process off from all but its own senses and radio.  "
            "[default: where the machine can]",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="New folder for the recordings and the result.  [default: in runs/]"
        ),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show the run while it goes on.")] = False,
    hardware: Annotated[
        bool,
        typer.Option(
            "--hardware-in-the-loop", help="Robots as on board, their devices emulated; in wall time."
        ),
    ] = False,
    trust: Annotated[
        bool, typer.Option("--trust", help="Run the code that the scenario names, whoever wrote it.")
    ] = False,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=N",
            help="What each robot's process may have: memory_mb, open_files, file_mb, disk_mb, disk_files, "
            "processes. Repeatable.",
        ),
    ] = None,
    timeout: Annotated[
        float,
        typer.Option(
            metavar="S",
            min=1,
            max=86400,
            help="The run ends once a process keeps all others from the next step for longer.",
        ),
    ] = 30.0,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else.")] = False,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Then execute every robot again: what follows more than it is told is found."
        ),
    ] = False,
) -> None:
    """Run a swarm and say what came of it. Options replace what the scenario says."""
    from deploy.run.options import folder_name, run_options
    from deploy.scenario.scenario_file import DEFAULT_SCENARIO, Overrides, load_scenario

    overrides = Overrides(robots, seed, duration, step, strategy)
    name = folder_name(scenario or DEFAULT_SCENARIO)
    options = run_options(
        out or Path("runs", name),
        speed=speed,
        bus=bus,
        spawn=spawn,
        isolate=isolate,
        scenario=(scenario or DEFAULT_SCENARIO).name,
        hidden=(scenario.absolute(),) if scenario else (),
        view=view,
        hardware=hardware,
        limit=limit or (),
        timeout=timeout,
        json=json,
        check=check,
    )
    chosen = load_scenario(scenario, overrides)

    from cleaning.strategies import entry
    from deploy.run import foreign

    if not trust:
        strategy = entry(chosen.run.strategy)
        foreign.refuse_foreign(scenario or DEFAULT_SCENARIO, strategy, foreign.beside(chosen))

    from deploy.processes.signals import Interrupted
    from deploy.results import deliveries, summary
    from deploy.run import out_folder, swarm
    from deploy.run.kernels import compile_kernels

    if out is None:
        options = replace(options, out=out_folder.claim(options.out.parent, name))
    try:
        with out_folder.dropped_if_empty(options.out), out_folder.writing(options.out):
            compile_kernels(quiet=json)
            if hardware:
                from deploy.field_trial import trial_summary
                from deploy.laboratory import hardware_in_the_loop

                trial_summary.print_field_trial(hardware_in_the_loop.run(chosen, options), json=json)
                return
            result = swarm.run(chosen, options)
    except Interrupted as interrupt:
        Console(stderr=True, soft_wrap=True, highlight=False).print(
            f"acrc: ended from outside; what was recorded is in {options.out}"
        )
        raise typer.Exit(interrupt.exit_code) from None
    summary.print_result(result, json=json)
    if view:
        summary.print_view(options.out)
    deliveries.demand_all(result.undelivered, result.not_delivered)
    if check:
        _check_again(options.out)


def _check_again(out: Path) -> None:
    """Execute a run's actors again; what comes out stands on standard error, beside the result."""
    from deploy.replay.recheck import recheck

    again = recheck(out)
    Console(stderr=True, soft_wrap=True, highlight=False).print(
        f"checked: {again.actors} actors executed again, all {again.outputs} messages equal"
    )


@app.command()
def strategies(
    json: Annotated[bool, typer.Option("--json", help="Print them as JSON, and nothing else.")] = False,
) -> None:
    """List the strategies that --strategy knows by name: shipped ones, and those of installed packages."""
    from deploy.cli.strategy_table import print_strategies

    print_strategies(json=json)


@app.command()
def onboard(
    fleet: Annotated[Path, typer.Argument(metavar="FLEET.toml", help="Which robots there are.")],
    robot: Annotated[str, typer.Option(metavar="ID", help="Which of them this is.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="New folder for the recordings.  [default: in runs/]")
    ] = None,
    isolate: Annotated[
        bool | None,
        typer.Option(
            "--isolate/--no-isolate",
            help="Shut the robot's process off from all but base and bridge.  [default: where it can be]",
        ),
    ] = None,
    debugpy: Annotated[
        int | None, typer.Option(metavar="PORT", min=1, max=65535, help="Let a debugger in there.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="Where it stands: `start`, as the fleet file has it, or X,Y,HEADING in m and rad.  "
            "[default: about where it last was, which it first makes sure of; `start` the first time]",
        ),
    ] = None,
) -> None:
    """Be a robot: drive the TurtleBot and the radio board that are plugged in, until told to stop."""
    from deploy.fleet import onboard_run
    from deploy.fleet.fleet_file import load_fleet
    from deploy.processes.signals import Interrupted
    from deploy.run import out_folder
    from deploy.run.kernels import compile_kernels

    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    loaded = load_fleet(fleet)
    if out is not None:
        out_folder.check(out, mesh=True)
    folder = out.absolute() if out else onboard_run.new_folder(Path("runs"))
    options = onboard_run.OnboardOptions(folder, isolate, debugpy, at)
    try:
        with out_folder.dropped_if_empty(folder):
            prepared = onboard_run.prepare(loaded, robot, options, console.print)
            compile_kernels(onboard=True)  # else it would seem to hang for a minute, or five on a small board
            onboard_run.run(prepared, console.print)
    except Interrupted as interrupt:
        console.print(f"acrc: ended from outside; what was recorded is in {folder}")
        raise typer.Exit(interrupt.exit_code) from None


@app.command()
def watch(
    endpoints: Annotated[
        list[str],
        typer.Argument(metavar="ENDPOINT…", help="Where robots listen, such as tls/192.168.1.12:7447."),
    ],
    keys: Annotated[Path, typer.Option(metavar="DIR", help="The operator's keys, by acrc deploy keys.")],
    stop: Annotated[bool, typer.Option("--stop", help="Stop these robots for good, and end.")] = False,
    pause: Annotated[bool, typer.Option("--pause", help="Let them stand until --resume, and end.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Let them go on, and end.")] = False,
) -> None:
    """See how robots on board get on, from a laptop; or stop them."""
    from actors.messages import Pause, Resume, Stop
    from deploy.fleet import watch as laptop

    wishes = [kind() for kind, wished in ((Stop, stop), (Pause, pause), (Resume, resume)) if wished]
    if len(wishes) > 1:
        raise OptionError("--stop, --pause, --resume: one at a time")
    code = 130
    if wishes:
        answers = laptop.give(endpoints, keys, wishes[0])
        for answer in answers:
            words = answer.failure or laptop.done(wishes[0])
            print(f"acrc: {answer.endpoint}: {words}", file=sys.stderr if answer.failure else sys.stdout)
        code = 1 if any(answer.failure for answer in answers) else 0
    else:
        with contextlib.suppress(KeyboardInterrupt):
            laptop.watch(endpoints, keys)
    sys.stdout.flush()
    os._exit(code)  # attempts that hang in the network keep their interpreter, and are not waited for


@app.command(context_settings={"ignore_unknown_options": True})
def order(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The folder of a run that is going on.")],
    verb: Annotated[str, typer.Argument(metavar="VERB", help="kill, freeze, move, pause, stop, …")],
    words: Annotated[list[str] | None, typer.Argument(metavar="WORDS", help="What the verb needs.")] = None,
) -> None:
    """Give an order to a run that is going on, such as: acrc order runs/mine kill r2.

    It says what became of the order; exit code 1 if the run refused it.
    """
    from deploy.run import orders

    given = " ".join([verb, *(words or [])])
    refusal = orders.send(out, orders.parse(verb, words or []))
    if refusal:
        raise AcrcError(f"the run refused the order {given!r} {refusal}")
    print(f"acrc: the run has carried out: {given}")


@app.command()
def add(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME…", help="As pip knows them: pandas, pandas==3.0.0.")
    ],
) -> None:
    """Install packages that your strategies import, and keep them, in requirements.txt of this clone."""
    raise OptionError(f"add {' '.join(names)}: is done by the script itself; call ./acrc of this clone")


@app.command(context_settings=_PASS_ON)
def test(context: typer.Context) -> None:
    """Run the tests, or those of your own that you name; whatever follows goes to pytest."""
    words = [_absolute(word) for word in context.args]
    here = str(Path.cwd())
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (here, os.environ.get("PYTHONPATH"))))
    from deploy.run.kernels import compile_kernels

    compile_kernels()  # or the first tests would wait for it, and see it said where a result is due
    raise typer.Exit(run_suite(REPOSITORY, words))


@app.command()
def check() -> None:
    """Check form, faults, arithmetic, types and imports of the sources."""
    if not run_checks(REPOSITORY, Console()):
        raise typer.Exit(1)


def _absolute(word: str) -> str:
    """An argument that names a file, or a test in one, as it is found from any folder."""
    path, colons, name = word.partition("::")
    return f"{Path(path).absolute()}{colons}{name}" if Path(path).exists() else word
