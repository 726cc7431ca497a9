"""The operator's laptop: sees how robots on board get on, and can stop them."""

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from actors.instant import in_seconds
from actors.messages import BOARD, CONTROL, PROGRESS, Board, Control, Order, Progress
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from actors.runtime.tls import laptop_config, load_keys
from actors.runtime.zenoh_bus import ZenohBus, open_mesh

PATIENCE_S = 10.0
"""How long a robot may take to be found."""
_LOOK_S = 0.1


def give(endpoints: Sequence[str], keys: Path, order: Order) -> None:
    """Give every robot an order; one that cannot be reached keeps none of the others from getting it."""
    failures = []
    for endpoint in endpoints:
        try:
            with open_mesh(laptop_config(load_keys(keys), endpoint), (), patience_s=PATIENCE_S) as bus:
                bus.publish(CONTROL.key(), encode(Control(0, (order,))))
        except Exception as error:  # whatever keeps one robot from hearing must not keep the others
            failures.append(error)
    if failures:
        raise failures[0]


def watch(endpoints: Sequence[str], keys: Path, seconds: float | None = None) -> None:
    """Print a line for every word of every robot, until interrupted or for so many seconds."""
    began = time.monotonic()
    with ExitStack() as stack:
        buses = {
            endpoint: stack.enter_context(
                open_mesh(
                    laptop_config(load_keys(keys), endpoint),
                    (at(PROGRESS), at(BOARD)),
                    patience_s=PATIENCE_S,
                )
            )
            for endpoint in endpoints
        }
        while seconds is None or time.monotonic() < began + seconds:
            for endpoint, bus in buses.items():
                for line in _news(bus):
                    sys.stdout.write(f"{endpoint}  {line}\n")
            sys.stdout.flush()
            time.sleep(_LOOK_S)


def _news(bus: ZenohBus) -> list[str]:
    lines = []
    for topic in (at(PROGRESS).topic, at(BOARD).topic):
        while (delivery := bus.poll(topic)) is not None:
            message = decode(delivery.topic, delivery.key, delivery.payload)
            if isinstance(message, Progress):
                state = "stopped" if message.finished else "paused" if message.paused else "running"
                lines.append(
                    f"step {message.step}: {message.places_left} places left, "
                    f"{message.reports} reported, {state}"
                )
            elif isinstance(message, Board):
                lines += [f"{in_seconds(note.instant):.3f} {note}" for note in message.notes]
    return lines
