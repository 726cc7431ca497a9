"""The bridge as a program: `python -m firmware_bridge.onboard.bridge --setup FILE --router ENDPOINT …`."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.instant import Instant, seconds
from actors.messages import RADIO_READY, Ready
from actors.runtime.access.rules import client_config
from actors.runtime.bus.waking_bus import WakingBus
from actors.runtime.client_options import ArgumentParser, ClientOptions, add_client_options, client_options
from actors.runtime.core import to
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.parent import die_with_parent
from actors.runtime.process import ActorProcess, RunNote, play
from actors.runtime.processor import processor
from actors.runtime.recording import Recorder
from actors.runtime.shell import Shell
from firmware_bridge.beeclick.link import Link
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.port import BoardPort, PortError
from firmware_bridge.onboard.bridge_core import BridgeCore
from firmware_bridge.onboard.clock import Clock
from firmware_bridge.onboard.conduct import conduct
from firmware_bridge.onboard.onboard_setup import BridgeSetup, load

_RETRY = seconds(1)
"""A port that is not there is tried again so often."""


@dataclass(frozen=True)
class BridgeOptions:
    """The bridge's command line."""

    setup: Path
    client: ClientOptions


def parse(argv: Sequence[str]) -> BridgeOptions:
    """The options in `argv`; ArgumentError if they make no sense."""
    parser = ArgumentParser(
        prog="python -m firmware_bridge.onboard.bridge", description="Talks by a BEE click."
    )
    parser.add_argument("--setup", required=True, type=Path, help="JSON file with the bridge's set-up")
    add_client_options(parser)
    given = parser.parse_args(argv)
    return BridgeOptions(given.setup, client_options(given))


class Bridge:
    """The bridge process around its core: the board's port, which may come and go."""

    def __init__(self, setup: BridgeSetup, clock: Clock) -> None:
        self._path = setup.radio
        self._clock = clock
        self._link = Link(BoardSettings(setup.address, setup.channel, setup.pan, setup.power_dbm))
        self.core = BridgeCore(setup.robot, self._link)
        self._port: BoardPort | None = None
        self._retry_at = Instant(0)
        self._said = ""

    def drive(self, shell: Shell, bus: WakingBus) -> None:
        """Run until the base says that it is over."""
        core = self.core
        try:
            conduct(shell, bus, core, self, self._clock, lambda: None, lambda: core.has_news)
        finally:
            if self._port is not None:
                self._port.close()

    @property
    def wake(self) -> Instant | None:
        """When a frame or the link is due."""
        return self.core.wake

    def descriptors(self) -> Sequence[int]:
        """What to wait for."""
        return () if self._port is None else (self._port.fileno(),)

    def serve(self, now: Instant) -> None:
        """Read what has come, write what is due; open the port anew if it has gone."""
        if self._port is None:
            self._connect(now)
        if self._port is None:
            self.core.due()  # frames whose instants have come wait with the link, which holds few
            return
        try:
            self.core.hear(self._port.read())
            if self._port.is_idle:
                self._port.write(self.core.due())
            else:
                self._port.write(b"")
        except PortError as error:
            self._say(str(error))
            self.core.lost()
            self._port.close()
            self._port = None

    def _connect(self, now: Instant) -> None:
        if now < self._retry_at:
            return
        self._retry_at = Instant(now + _RETRY)
        try:
            self._port = BoardPort(self._path)
        except PortError as error:
            self._say(str(error))
            return
        self._say("")
        self._link.connect(now)

    def _say(self, sentence: str) -> None:
        """Each thing once, into the process's log."""
        if sentence and sentence != self._said:
            sys.stderr.write(f"{sentence}\n")
            sys.stderr.flush()
        self._said = sentence


def part(bridge: Bridge, setup: BridgeSetup, argv: Sequence[str], commit: str) -> ActorProcess:
    """The bridge and its connections."""
    run = RunNote(
        actor="radio",
        argv=tuple(argv),
        seed=0,
        step_us=setup.step_us,
        commit=commit,
        scenario=msgspec.json.encode(setup).decode(),
        kernels={},
        processor=processor(),
    )
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
        options = parse(argv)
        if options.client.with_parent:
            die_with_parent(os.getppid())
        setup = load(options.setup, BridgeSetup)
        bridge = Bridge(setup, Clock())
        process = part(bridge, setup, argv, options.client.commit)
        config = client_config(options.client.credentials, options.client.router)
        return play(process, Recorder(options.client.record, setup.step_us), config)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
