"""What the operator's laptop does with robots on board: watch, stop, pause and resume them."""

import contextlib
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from actors.processes.signals import Interrupted
from command_line.options import Endpoints, Json, OperatorKeys, answer

if TYPE_CHECKING:
    from actors.orders import Order


def watch(
    endpoints: Endpoints,
    keys: OperatorKeys,
    view: Annotated[
        Path | None,
        typer.Option(metavar="FLEET.toml", help="Show robots in the viewer, on the fleet's map."),
    ] = None,
) -> None:
    """Watch robots from a laptop, until Ctrl-C."""
    from deploy.fleet import watch as laptop

    with contextlib.suppress(Interrupted):
        if view is None:
            laptop.watch(endpoints, keys)
        else:
            _show(endpoints, keys, view)
    _leave(130)


def _show(endpoints: list[str], keys: Path, fleet: Path) -> None:
    """What `--view` alone needs."""
    from deploy.fleet import watched
    from deploy.fleet.fleet_file import load_fleet

    watched.show(endpoints, keys, load_fleet(fleet))


def stop(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Stop all robots for good.

    Within 2 s each robot has confirmed, or is named with what is in the way; then the exit code is 1.
    """
    from actors.orders import Stop

    _give(endpoints, keys, Stop(), json=json)


def pause(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Pause all robots until resume; answers as of stop."""
    from actors.orders import Pause

    _give(endpoints, keys, Pause(), json=json)


def resume(endpoints: Endpoints, keys: OperatorKeys, json: Json = False) -> None:
    """Resume paused robots; answers as of stop."""
    from actors.orders import Resume

    _give(endpoints, keys, Resume(), json=json)


def _give(endpoints: list[str], keys: Path, order: "Order", *, json: bool) -> NoReturn:
    """Give an order to all robots, and say what became of it."""
    from deploy.fleet import watch as laptop

    answers = laptop.give(endpoints, keys, order)
    for one in answers:
        if one.failure:
            print(f"acrc: {one.endpoint}: {one.failure}", file=sys.stderr)
    said = [f"acrc: {one.endpoint}: {laptop.done(order)}" for one in answers if not one.failure]
    answer(said, [{"endpoint": one.endpoint, "failure": one.failure} for one in answers], json=json)
    _leave(1 if any(one.failure for one in answers) else 0)


def _leave(code: int) -> NoReturn:
    """End at once: attempts that hang in the network keep their interpreter, and are not waited for."""
    sys.stdout.flush()
    os._exit(code)
