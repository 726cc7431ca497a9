"""Program of the map page: `python -m deploy.control RUN ADDRESS`."""

import asyncio
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from actors.radio.radio_model import RadioProgram
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import unix_endpoint
from actors.runtime.isolation.rules import client_config
from actors.runtime.linux import die_with_parent, exit_on_sigterm
from actors.runtime.process_setup import SETUP, ArgumentParser, read_setup
from actors.runtime.zenoh_bus import open_mesh
from actors.world.program import load_setup
from deploy.control.scene import Scene
from deploy.control.server import ADDRESSES, ControlServer, RunLink

POLL_INTERVAL_S: Final = 0.05
"""Interval between polls of the run's messages, s: 20 updates per second."""
_CLOSING_DELAY_S: Final = 0.5


def main(argv: Sequence[str]) -> int:
    """Serve until the run has ended; return the exit code."""
    exit_on_sigterm()
    die_with_parent(os.getppid())
    parser = ArgumentParser(prog="python -m deploy.control", description="Serve the map page of a run.")
    parser.add_argument("run", type=Path, help="folder of the run, whose world has started")
    parser.add_argument("address", type=Path, help="file for the page's address")
    try:
        options = parser.parse_args(argv)
        world = options.run / "world"
        setup = load_setup(world / SETUP)
        radio = read_setup(options.run / "radio" / SETUP, RadioProgram, "a radio").actor
        scene = Scene(setup.actor.resolve_paths(world), radio, setup.process.speed or 0.0)
        router = unix_endpoint(world / "router.sock")
        observer = client_config(world / "observer.credentials", router, lossy=True)
        operator = client_config(world / "operator.credentials", router)
        with ExitStack() as stack:
            messages = stack.enter_context(open_mesh(observer, ADDRESSES, lossy=True))
            orders = stack.enter_context(open_mesh(operator, ()))
            asyncio.run(_serve(scene, RunLink(scene, messages, orders), options.address))
        return 0
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


async def _serve(scene: Scene, link: RunLink, address: Path) -> None:
    pages = ControlServer(scene, link)
    async with await pages.start():
        os.umask(0o077)  # readable by the owner only
        regular_file.write_atomically(address, pages.url.encode())
        try:
            while not scene.over:
                link.poll()
                pages.send_changes()
                await asyncio.sleep(POLL_INTERVAL_S)
            await asyncio.sleep(_CLOSING_DELAY_S)
        finally:
            address.unlink(missing_ok=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
