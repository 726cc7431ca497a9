"""The map page as a program: `python -m deploy.control SETUP --router ENDPOINT …`."""

import asyncio
import os
import sys
from argparse import Namespace
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from actors.floor.map_file import load_map
from actors.radio.radio_model import RadioProgram
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.rules import client_config
from actors.runtime.linux import die_with_parent, leave_in_order
from actors.runtime.process_setup import ArgumentParser, read_setup
from actors.runtime.zenoh_bus import open_mesh
from actors.world.program import load_setup
from deploy.control.scene import Scene
from deploy.control.server import LISTENS, ControlServer, RunLink

LOOK_S: Final = 0.05
"""Between two looks at what the run has said: 20 pictures a second."""
_FAREWELL_S: Final = 0.5


def parse(argv: Sequence[str]) -> Namespace:
    """The options in `argv`; ArgumentError if they make no sense."""
    parser = ArgumentParser(prog="python -m deploy.control", description="Serves the map page of a run.")
    parser.add_argument("setup", type=Path, help="the world's set-up, its setup.json")
    parser.add_argument("--router", required=True, help="endpoint of the router")
    for name, words in (
        ("radio", "the radio's set-up, its setup.json"), ("address", "file for the page's address"),
        ("observer", "credentials of who looks on"), ("operator", "credentials of who gives orders"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", required=True, type=Path, help=words)
    return parser.parse_args(argv)


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
        scene = Scene(setup, load_map(setup.map), told.process.speed or 0.0, addresses)
        observer = client_config(options.observer, options.router, onlooker=True)
        operator = client_config(options.operator, options.router)
        with ExitStack() as stack:
            looks = stack.enter_context(open_mesh(observer, LISTENS, onlooker=True))
            speaks = stack.enter_context(open_mesh(operator, ()))
            asyncio.run(_serve(scene, RunLink(scene, looks, speaks), options.address))
        return 0
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


async def _serve(scene: Scene, link: RunLink, address: Path) -> None:
    pages = ControlServer(scene, link)
    async with await pages.start():
        part = address.with_suffix(".part")  # for the owner's eyes only, and whole once it has its name
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(pages.url)
        part.rename(address)
        try:
            while not scene.over:
                link.look()
                pages.renew()
                await asyncio.sleep(LOOK_S)
            await asyncio.sleep(_FAREWELL_S)
        finally:
            address.unlink(missing_ok=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
