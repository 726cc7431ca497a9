"""Options of a run that do not change its result."""

import math
import os
import re
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import msgspec
from msgspec.structs import replace

from actors.installation.usage import OptionError, check_choice, wrong_value
from actors.processes.monitor import Timeout
from actors.runtime.isolation.sandbox import ProcessLimits
from actors.runtime.process_setup import RecordDetail
from actors.settings import ParameterError, decode
from actors.user_code import RecordedModules
from deploy.run import out_folder

if TYPE_CHECKING:  # runs without ROS 2 import nothing of it
    from firmware_bridge.ros2.settings import RouterLink

MIN_SPEED = 0.01
"""Minimum of --speed, at which a step of 100 ms takes 10 s, well below the default timeout."""
_LONGEST_STEP_S = 0.1
"""Maximum step of a scenario, s."""
Bus = Literal["zenoh", "memory"]


class _Output(msgspec.Struct, frozen=True):
    """The only option that may be given by position."""

    out: Path
    """Absolute path of a new or empty folder for everything that the run writes."""


class RunOptions(_Output, frozen=True, kw_only=True):
    """The options of `acrc run` that are not part of the scenario."""

    record: RecordDetail = "full"
    """Level of detail of recordings; `lean`: without the introspection that viewers and exports show."""
    speed: str = "max"
    """Simulated seconds per second as a number, or "max"."""
    bus: str = "zenoh"
    """zenoh: one process per actor; memory: all actors in this process."""
    spawn: str = "forkserver"
    """Start method of processes: forkserver (forked with all imports) or exec."""
    isolate: bool | None = None
    """Run every robot's process in a sandbox with access only to its own topics; None: if possible."""
    scenario: str = ""
    """Name of the scenario's file, for the result."""
    hidden: tuple[Path, ...] = ()
    """Files hidden from robots, even beside their strategy's code: the scenario."""
    view: bool = False
    """Open a live viewer."""
    ros2: bool = False
    """Publish the run's ROS 2 topics."""
    router: str = ""
    """With `ros2`: endpoint of the Zenoh router; empty: the default."""
    debug: str | None = None
    """Robot to debug: its breakpoints stop the run, at this terminal."""
    control: bool = False
    """Serve the map page, which accepts orders."""
    hardware: bool = False
    """Run the robots' hardware processes with emulated devices, in wall time."""
    boards: tuple[str, ...] = ()
    """With `hardware`: robots with an emulated board instead of a simulated transceiver; empty: all."""
    limits: ProcessLimits = msgspec.field(default=ProcessLimits())
    """Resource limits of each robot's process."""
    timeout_s: float = Timeout.step_s
    """Stall timeout of an actor's step, s; see `actors.processes.monitor`."""
    on: str = ""
    """Address of the cluster that hosts the robots; empty: this computer."""
    listen: str = ""
    """Address at which hosts connect, `HOST` or `HOST:PORT`; empty: this computer's in the cluster."""
    leave: bool = False
    """Keep recordings on the hosts."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""
    check: bool = False
    """Replay every actor afterwards, and compare."""
    log: tuple[str, ...] = ()
    """Robots whose output is shown; `*`: all."""
    followed: tuple[str, ...] = ()
    """Robots shown in detail in the viewer; empty: its default."""
    modules: tuple[Path, ...] = ()
    """Folders with modules of user strategies, from `code_permit.permitted_folders`."""
    recorded: RecordedModules | None = None
    """Required content of these modules, for a run in memory; None: any."""


def check_options(options: RunOptions, limit: Sequence[str] = ()) -> RunOptions:
    """Check the options; return them with an absolute `out` and the process limits `limit` (NAME=N each).

    Raises OptionError.
    """
    check_choice("--bus", options.bus, get_args(Bus))
    check_choice("--record", options.record, get_args(RecordDetail))
    check_choice("--spawn", options.spawn, ("forkserver", "exec"))
    speed = _checked_speed(options.speed)
    if options.ros2:
        router_link(options.router)
    for is_present, sentence in _conflicts(options, limit):
        if is_present:
            raise OptionError(sentence)
    if speed != "max" and not options.timeout_s > (slowest := _LONGEST_STEP_S / float(speed)):
        raise wrong_value(
            "--timeout", f"{options.timeout_s:g}", f"more than the {slowest:g} s of a step at --speed {speed}"
        )
    return replace(
        options,
        out=out_folder.checked_path(options.out, mesh=options.bus == "zenoh"),
        limits=parse_limits(limit),
    )


def _conflicts(options: RunOptions, limit: Sequence[str]) -> tuple[tuple[object, str], ...]:
    """Return whether each conflict between options is present, and its sentence."""
    memory, hardware, debug = options.bus == "memory", options.hardware, options.debug
    followed, board = (next(iter(robots), "") for robots in (options.followed, options.boards))
    return (
        (
            options.isolate and memory,
            "--isolate: requires --bus zenoh; --bus memory has one process for all robots",
        ),
        (options.view and memory, "--view: requires --bus zenoh; --bus memory has one process for all"),
        (options.ros2 and memory, "--ros2: requires --bus zenoh; --bus memory has one process for all"),
        (options.router and not options.ros2, f"--router: {options.router}; requires --ros2"),
        (
            options.followed and not options.view,
            f"--robot: {followed!r}; requires --view; --robots sets the number of robots",
        ),
        (
            debug is not None and hardware,
            "--debug: stops simulated time; cannot be combined with --hardware-in-the-loop",
        ),
        (
            debug is not None and not sys.stdin.isatty(),
            f"--debug: {debug}; standard input must be a terminal",
        ),
        (
            options.control and (memory or hardware),
            "--control: requires --bus zenoh; it gives orders over the mesh of a simulated run",
        ),
        (
            options.on and (memory or hardware or debug is not None),
            "--on: starts robots' processes on other computers; cannot be combined with --bus memory, "
            "--hardware-in-the-loop or --debug",
        ),
        (options.listen and not options.on, f"--listen: {options.listen}; requires --on"),
        (
            options.leave and not options.on,
            "--leave: requires --on; without it recordings are on this computer",
        ),
        (
            options.leave and (options.check or options.view or options.ros2),
            "--leave: keeps recordings on the hosts; cannot be combined with --check, --view or --ros2, "
            "which read them",
        ),
        (
            hardware and (memory or options.view or options.ros2 or options.speed not in {"max", "1"}),
            "--hardware-in-the-loop: runs processes in wall time; "
            "cannot be combined with --bus memory, --view, --ros2 or a --speed other than 1",
        ),
        (options.boards and not hardware, f"--board: {board}; requires --hardware-in-the-loop"),
        (
            hardware and options.log,
            "--log: shows simulated robots; cannot be combined with --hardware-in-the-loop",
        ),
        (
            hardware and options.check,
            "--check: replays a simulated run; cannot be combined with --hardware-in-the-loop",
        ),
        (
            limit and (memory or hardware),
            "--limit: requires --bus zenoh; it limits a simulated robot's process",
        ),
    )


def router_link(router: str) -> "RouterLink":
    """Return the link to `--router` in the domain of ROS_DOMAIN_ID. Raises OptionError."""
    from firmware_bridge.ros2.settings import RouterLink  # noqa: PLC0415

    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    number: object = int(domain) if domain.isdecimal() else domain
    try:
        return decode(RouterLink, {"domain": number} | ({"router": router} if router else {}))
    except ParameterError as error:
        raise OptionError(f"--ros2: {error}") from None


def run_folder_name(scenario: Path, strategy: str | None = None) -> str:
    """Return the name of a run's folder: scenario, strategy if given, and UTC time."""
    name = f"{scenario.stem}{f'-{strategy}' if strategy else ''}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    return re.sub(r"[^\w.-]", "-", name)  # a socket's path must not contain "#" or "?"


def parse_limits(words: Sequence[str]) -> ProcessLimits:
    """Parse limits, each as `name=number`. Raises OptionError."""
    values, names = {}, ProcessLimits.__struct_fields__
    for word in words:
        name, _, number = word.partition("=")
        if name not in names or not re.fullmatch("0*[1-9][0-9]{0,8}", number):
            expected = f'one of {", ".join(names)}, "=" and a number from 1 to 999999999'
            raise wrong_value("--limit", word, expected)
        values[name] = int(number)
    return ProcessLimits(**values)


def _checked_speed(text: str) -> str:
    if text == "max":
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not MIN_SPEED <= value < math.inf:
        raise wrong_value("--speed", text, '"max" or a number of at least 0.01, such as 1 or 4')
    return text
