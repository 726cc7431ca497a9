"""Link for tests: reception by a table, one step after transmission."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from deeco import START, Duration, Instant, milliseconds
from deeco.link import Reception, Transmission
from deeco.node import Node

Reach = Callable[[str, str], float | None]
"""Signal strength of the first at the second, dBm; None: no reception."""

STEP = milliseconds(100)


def everywhere(sender: str, receiver: str) -> float | None:
    return -60.0


@dataclass
class FakeLink:
    nodes: Mapping[str, Node]
    reach: Reach = everywhere
    step: Duration = STEP
    now: Instant = START
    sent: list[tuple[str, Transmission]] = field(default_factory=list)
    _in_flight: list[tuple[str, Transmission]] = field(default_factory=list)

    def run(self, duration: Duration) -> None:
        end = self.now + duration
        while self.now < end:
            self.now = Instant(self.now + self.step)
            in_flight, self._in_flight = self._in_flight, []
            for name, node in self.nodes.items():
                heard = [
                    Reception(frame.instant, self._address(sender), frame.data, rssi)
                    for sender, frame in in_flight
                    if sender != name and (rssi := self.reach(sender, name)) is not None
                ]
                for frame in node.advance(self.now, heard):
                    self._in_flight.append((name, frame))
                    self.sent.append((name, frame))

    def _address(self, name: str) -> int:
        return list(self.nodes).index(name) + 1
