"""The map page as a program: `python -m deploy.control SETUP --router ENDPOINT …`."""

import asyncio
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from actors.floor.map_file import load_map
from actors.radio.radio_model import RadioProgram
from actors.runtime.access.rules import client_config
from actors.runtime.bus.zenoh_bus import open_mesh
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.linux import die_with_parent, leave_in_order
from actors.runtime.process_setup import ArgumentParser, read_setup
from actors.world.program import load_setup
from deploy.control.page_floor import PageFloor
from deploy.control.run_link import LISTENS, OrderLines, RunLink
from deploy.control.scene import Scene
from deploy.control.server import ControlServer

LOOK_S: Final = 0.05
"""Between two looks at what the run has said: 20 pictures a second."""
_FAREWELL_S: Final = 0.5
"""So long a page has to take in that the run is over."""


@dataclass(frozen=True)
class ControlOptions:
    """The program's command line."""

    setup: Path
    radio: Path
    address: Path
    router: str
    observer: Path
    operator: Path


def parse(argv: Sequence[str]) -> ControlOptions:
    """The options in `argv`; ArgumentError if they make no sense."""
    parser = ArgumentParser(prog="python -m deploy.control", description="Serves the map page of a run.")
    parser.add_argument("setup", type=Path, help="the world's set-up, its setup.json")
    parser.add_argument("--radio", required=True, type=Path, help="the radio's set-up, its setup.json")
    parser.add_argument("--address", required=True, type=Path, help="file for the page's address")
    parser.add_argument("--router", required=True, help="endpoint of the router")
    parser.add_argument("--observer", required=True, type=Path, help="credentials of who looks on")
    parser.add_argument("--operator", required=True, type=Path, help="credentials of who gives orders")
    return ControlOptions(**vars(parser.parse_args(argv)))


def main(argv: Sequence[str]) -> int:
    """Serve until the run is over; the exit code."""
    leave_in_order()
    die_with_parent(os.getppid())
    try:
        options = parse(argv)
        told = load_setup(options.setup)
        setup = told.actor.located(options.setup.parent)
        radio = read_setup(options.radio, RadioProgram, "a radio").actor
        addresses = {address: robot for robot, address in radio.robots}
        plan, lines = PageFloor(setup, load_map(setup.map)), OrderLines()
        scene = Scene(setup, plan, told.process.speed or 0.0, addresses)
        observer = client_config(options.observer, options.router, onlooker=True)
        operator = client_config(options.operator, options.router)
        with ExitStack() as stack:
            looks = stack.enter_context(open_mesh(observer, LISTENS, onlooker=True))
            speaks = stack.enter_context(open_mesh(operator, ()))
            asyncio.run(_serve(scene, lines, RunLink(scene, lines, looks, speaks), options.address))
        return 0
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


async def _serve(scene: Scene, lines: OrderLines, link: RunLink, address: Path) -> None:
    pages = ControlServer(scene, lines, link.give)
    async with await pages.start():
        _write(address, pages.url)
        try:
            while not scene.over:
                link.look()
                pages.tell()
                if scene.changed:
                    scene.changed = False
                    pages.renew()
                await asyncio.sleep(LOOK_S)
            pages.renew()
            await asyncio.sleep(_FAREWELL_S)
        finally:
            address.unlink(missing_ok=True)


def _write(address: Path, url: str) -> None:
    """For the owner's eyes only, and whole once it is there."""
    part = address.with_suffix(".part")
    with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(url)
    part.rename(address)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
