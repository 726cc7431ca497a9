"""Arguments and options shared by several commands, and their output."""

import difflib
import os
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actors.installation.repository import SHIPPED

if TYPE_CHECKING:
    from rich.table import Table

    from actors.robot.behaviour.code_permit import Permit


def scenarios() -> list[str]:
    """Return paths of the shipped scenarios and TOML files of the working directory."""
    shipped = sorted((SHIPPED / "scenarios").glob("*.toml"))
    here = sorted(path.name for path in Path().glob("*.toml"))
    return [*here, *map(os.path.relpath, shipped)]


def strategies() -> list[str]:
    """Return names of strategies, without importing any."""
    from cleaning.strategies import strategies as known

    return [one.name for one in known()]


def orders() -> list[str]:
    """Return verbs of orders to a run."""
    from deploy.run.order_bus import VERBS

    return [*VERBS]


def navigation() -> list[str]:
    """Return presets of navigation."""
    from actors.robot.navigation.navigator import NAVIGATION_PRESETS

    return [*NAVIGATION_PRESETS]


def option(metavar: str, text: str, *names: str, **others: Any) -> Any:
    """Declare an option with a value, by default named like its parameter, with the help `text`."""
    return typer.Option(*names, metavar=metavar, help=text, **others)


def flag(text: str, *names: str) -> Any:
    """Declare an option without a value, with the help `text`."""
    return typer.Option(*names, help=text)


def isolation(text: str) -> Any:
    """Declare `--isolate/--no-isolate`; the default None means if the system supports it."""
    return flag(f"{text}  [default: if the system supports it]", "--isolate/--no-isolate")


def argument(metavar: str, text: str, **others: Any) -> Any:
    """Declare an argument."""
    return typer.Argument(metavar=metavar, help=text, **others)


def command_group(text: str, *commands: Callable[..., None]) -> typer.Typer:
    """Return a group of commands, each named like its function, with the help `text`."""
    group = typer.Typer(help=text, no_args_is_help=True, add_completion=False, rich_markup_mode=None)
    for command in commands:
        group.command()(command)
    return group


ScenarioFile = Annotated[
    Path | None,
    argument(
        "SCENARIO.toml",
        "Scenario to run.  [default: scenarios/chapter.toml, the chapter's experiment]",
        autocompletion=scenarios,
    ),
]
FleetFile = Annotated[Path, argument("FLEET.toml", "Fleet file, which lists the robots.")]
Json = Annotated[bool, flag("Print only JSON on standard output.", "--json")]
Ros2 = Annotated[bool, flag("Publish live topics for ROS 2 tools (rmw_zenoh).", "--ros2")]
Router = Annotated[
    str | None,
    option(
        "ENDPOINT",
        "With --ros2: connect to this Zenoh router, or be it.  [default: tcp/127.0.0.1:7447]",
    ),
]
OperatorKeys = Annotated[Path, option("DIR", "Use these keys of the operator, from `acrc fleet keys`.")]
Endpoints = Annotated[
    list[str], argument("ENDPOINT…", "Endpoints of the robots, such as tls/192.168.1.12:7447.")
]
Modules = Annotated[
    list[Path] | None, option("DIR", "Also load strategies from this folder. Repeatable.", "--modules")
]
Record = Annotated[
    str,
    option(
        "full|lean",
        "Record internal states of robots for viewers and exports, too (full), or only data for results "
        "and causes (lean).",
        autocompletion=lambda: ["full", "lean"],
    ),
]
Trust = Annotated[
    bool, flag("Run code that the file names even if it is elsewhere or has changed.", "--trust")
]
RunFolder = Annotated[Path, argument("OUT", "Folder of a run.")]
CampaignFolder = Annotated[Path, argument("DIR", "Folder of a campaign.", show_default=False)]
Robots = Annotated[str | None, option("N", "Set the number of robots.")]
Seed = Annotated[str | None, option("N", "Set the random seed; equal seeds give equal runs.")]
Setting = Annotated[
    list[str] | None,
    option("KEY=VALUE", "Override a key of the scenario: deeco.publish=0.5. Repeatable.", "--set"),
]


def permission(modules: Sequence[Path] | None, *, trust: bool = False) -> "Permit":
    """Return the permission given by `--modules` and `--trust`. Raises OptionError."""
    from actors.robot.behaviour.code_permit import permit_of  # loads numpy

    return permit_of(modules, trust=trust)


def suggestion(name: str, known: Collection[str]) -> str:
    """Return the remedy for an unknown name: the most similar one, or all."""
    matches = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {matches[0]}?" if matches else f"choose from {', '.join(known)}"


def check_absent(reason: str, options: Mapping[str, object]) -> None:
    """Raise OptionError if one of the options, by name, was given."""
    from actors.installation.usage import OptionError

    for name, value in options.items():
        if value is not None:
            raise OptionError(f"{name}: {reason}")


def _encodable(value: Any) -> Any:
    """Return the number in a numpy scalar; other values as text."""
    return value.item() if hasattr(value, "item") else str(value)


def answer(shown: "Iterable[str | Table]", data: object, *, json: bool) -> None:
    """Print the sentences and tables `shown` or, with `json`, `data` as one line of JSON."""
    if json:
        import msgspec

        sys.stdout.write(msgspec.json.encode(data, enc_hook=_encodable).decode() + "\n")
        return
    from actors.console import print_parts

    print_parts(shown)
