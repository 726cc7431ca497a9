"""The observer as a program: `python -m actors.observer --out FOLDER --map FILE --router ENDPOINT …`."""

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.messages import DRIVE, TRUTH, Drive, Truth
from actors.observer.observer import Observer, ViewSummary
from actors.runtime.access.rules import client_config
from actors.runtime.bus.zenoh_bus import ZenohBus, open_mesh
from actors.runtime.bus_interface import Delivery
from actors.runtime.client_options import ArgumentParser
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.parent import die_with_parent, leave_in_order
from actors.topic import Message, sender


@dataclass(frozen=True)
class ObserverOptions:
    """The observer's command line."""

    out: Path
    """Folder for view.rrd."""
    map: Path
    places: Path
    """JSON file: a list of points, m, by robot."""
    router: str
    credentials: Path
    with_parent: bool


def parse(argv: Sequence[str]) -> ObserverOptions:
    """The options in `argv`; ArgumentError if they make no sense."""
    parser = ArgumentParser(prog="python -m actors.observer", description="Shows a run.")
    parser.add_argument("--out", required=True, type=Path, help="folder for view.rrd")
    parser.add_argument("--map", required=True, type=Path, help="YAML file of the floor plan")
    parser.add_argument("--places", required=True, type=Path, help="JSON file: points by robot")
    parser.add_argument("--router", required=True, help="endpoint of the router")
    parser.add_argument("--credentials", required=True, type=Path, help="file with one line user:password")
    parser.add_argument("--with-parent", action="store_true", help="end when the starting process ends")
    return ObserverOptions(**vars(parser.parse_args(argv)))


def load_places(path: Path) -> dict[str, list[Point]]:
    """The robots' places out of a JSON file."""
    given = msgspec.json.decode(path.read_bytes(), type=dict[str, list[tuple[float, float]]])
    return {robot: [Point(*place) for place in places] for robot, places in given.items()}


def main(argv: Sequence[str]) -> int:
    """Show a run until it halts; the exit code."""
    leave_in_order()
    try:
        options = parse(argv)
        if options.with_parent:
            die_with_parent(os.getppid())
        config = client_config(options.credentials, options.router, onlooker=True)
        with open_mesh(config, (at(TRUTH), at(DRIVE, "*")), onlooker=True) as bus:
            grid, places = load_map(options.map), load_places(options.places)
            observer = Observer(options.out, grid, places, say=_say)
            try:
                _watch(bus, observer)
            finally:
                for sentence in _gaps(observer.close()):
                    _say(sentence)
        return 0
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


def _watch(bus: ZenohBus, observer: Observer) -> None:
    """Show everything until the run halts; what robots said comes before the truth that follows it."""
    while True:
        truth = _message(bus.receive(at(TRUTH).topic))
        assert isinstance(truth, Truth)
        while (delivery := bus.poll(at(DRIVE, "*").topic)) is not None:
            drive = _message(delivery)
            assert isinstance(drive, Drive)
            observer.drive(sender(delivery.key) or "", drive)
        observer.truth(truth)
        if truth.halt:
            return


def _say(sentence: str) -> None:
    sys.stdout.write(f"{sentence}\n")
    sys.stdout.flush()


def _gaps(summary: ViewSummary) -> Iterator[str]:
    """What the view lacks of the run, in sentences; the world's last word is a Truth of its own."""
    if summary.missed:
        yield f"the view lacks {summary.missed} steps that were not received"
    if not summary.whole:
        yield f"the view ends before step {summary.expected}: what came later was not received"


def _message(delivery: Delivery) -> Message:
    return decode(delivery.topic, delivery.key, delivery.payload)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
