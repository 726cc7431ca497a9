"""The bridge as a program: `python -m firmware_bridge.onboard.bridge SETUP`."""

import functools
import os
import sys
from collections.abc import Sequence

from actors.instant import Instant
from actors.messages import RADIO_READY, Ready
from actors.runtime.access.rules import client_config
from actors.runtime.background import SparingRecorder, to_stderr
from actors.runtime.bus.waking_bus import WakingBus
from actors.runtime.command_line import setup_parser
from actors.runtime.core import to
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.parent import die_with_parent
from actors.runtime.process import ActorProcess, play, run_note
from actors.runtime.process_setup import read_setup
from actors.runtime.shell import Shell
from firmware_bridge.beeclick.link import BoardLink
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.port import BoardPort
from firmware_bridge.onboard.bridge_core import BridgeCore
from firmware_bridge.onboard.conduct import Clock, conduct
from firmware_bridge.onboard.onboard_setup import BridgeProgram, BridgeSetup
from firmware_bridge.onboard.wire import ReconnectingPort
from firmware_bridge.transceiver_line import TransceiverLink


class Bridge:
    """The bridge process around its core: the board's port, which may come and go."""

    def __init__(self, setup: BridgeSetup, clock: Clock) -> None:
        self._clock = clock
        settings = BoardSettings(setup.address, setup.channel, setup.pan, setup.power_dbm)
        self._link = BoardLink(settings) if setup.board else TransceiverLink()
        self.core = BridgeCore(setup.robot, self._link)
        self._line = ReconnectingPort(
            functools.partial(BoardPort, setup.radio), lambda sentence: to_stderr(f"{sentence}\n")
        )

    def drive(self, shell: Shell, bus: WakingBus) -> None:
        """Run until the base says that it is over."""
        core = self.core
        try:
            conduct(shell, bus, core, self, self._clock, lambda: None, lambda: core.has_news)
        finally:
            self._line.close()

    @property
    def wake(self) -> Instant | None:
        """When a frame or the link is due."""
        return self.core.wake

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return self._line.descriptors()

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; open the port anew if it has gone."""
        if self._line.connect(now):
            self._link.connect(now)
        if self._line.port is None:
            self.core.due()  # frames whose instants have come wait with the link, which holds few
        elif not self._line.exchange(self._converse):
            self.core.lost()

    def _converse(self, port: BoardPort) -> bool:
        """Give the core what the board says, and the board what is due as soon as it takes it; True."""
        self.core.hear(port.read())
        port.write(self.core.due() if port.is_idle else b"")
        return True


def part(bridge: Bridge, setup: BridgeSetup, commit: str) -> ActorProcess:
    """The bridge and its connections."""
    run = run_note("radio", setup, commit)
    return ActorProcess(
        core=bridge.core,
        listens=bridge.core.listens(),
        run=run,
        ready=to(RADIO_READY, Ready(0, "radio", 0, "")),
        bus=WakingBus,
        drive=bridge.drive,
        outcome=bridge.core.outcome,
    )


def main(argv: Sequence[str]) -> int:
    """Bridge until the base has ended; the exit code."""
    try:
        parser = setup_parser("firmware_bridge.onboard.bridge", "Talks by a BEE click.")
        file = parser.parse_args(argv).setup
        told, folder = read_setup(file, BridgeProgram, "a bridge"), file.parent
        setup, place = told.actor, told.process
        if place.with_parent:
            die_with_parent(os.getppid())
        bridge = Bridge(setup, Clock())
        process = part(bridge, setup, place.commit)
        config = client_config(folder / place.credentials, place.endpoint(folder))
        return play(process, SparingRecorder(folder / place.record, setup.step_us), config)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
