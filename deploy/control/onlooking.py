"""What one sees of robots from outside: who stands, where they were, who hears whom."""

import math
from collections import deque
from typing import Final

from acrc_testbed.accounting.episodes import STANDARD
from actors.messages import Heard, Received
from actors.task.task import PlaceKey
from deploy.control.wire import MapRobot, Waypoint

TRAIL_S: Final = 20.0
"""So long a trail is, simulated s."""
TRAIL_STEP_S: Final = 0.5
"""Between two points of it."""
LINK_S: Final = 3.0
"""For so long after a frame who heard it and who sent it are linked, simulated s. Own choice: robots of the
chapter's experiment speak once a second."""
LINKS: Final = 400
"""At most; of more, the newest are shown."""


class SeenRobot:
    """One robot. It stands and is blocked as the accounting has it (`EpisodeParameters`)."""

    def __init__(self, robot: str, start: tuple[float, float, float], route: tuple[PlaceKey, ...]) -> None:
        self.id = robot
        self.x, self.y, self.heading = start
        self.route = route
        """The places that it still means to visit, by its own account."""
        self.standing = "driving"
        """driving, frozen or off."""
        self.trail: deque[Waypoint] = deque(maxlen=int(TRAIL_S / TRAIL_STEP_S) + 1)
        self._since = 0.0
        """When, simulated s, it came to where it is ..."""
        self._there = (self.x, self.y)
        """... or was then, m: it has stayed within `still` of it."""

    def put(self, x: float, y: float, heading: float) -> None:
        """It was carried away."""
        self.x, self.y, self.heading = x, y, heading

    def see(self, second: float, x: float, y: float, heading: float, standing: str) -> None:
        """It is there now."""
        self.put(x, y, heading)
        if standing != self.standing or math.dist(self._there, (x, y)) > STANDARD.still:
            self._since, self._there = second, (x, y)
        self.standing = standing
        if not self.trail or second - self.trail[-1][0] >= TRAIL_STEP_S:
            self.trail.append((_brief(second), _brief(x), _brief(y)))

    def stays(self, second: float) -> bool:
        """True if its program goes, and it has not got on lately."""
        return self.standing == "driving" and second - self._since >= STANDARD.pause_s

    def shown(self, second: float, destination: tuple[float, float] | None, near: str) -> MapRobot:
        """It on the map, with where it heads for; `near`: the robot that is nearest to it and in reach."""
        state, blocker = self.standing, ""
        if self.stays(second):
            state = "idle" if not self.route else "blocked" if near else "standing"
            blocker = near if state == "blocked" else ""
        where = destination if self.standing == "driving" else None
        return MapRobot(self.id, _brief(self.x), _brief(self.y), _brief(self.heading), state, where, blocker)


class Links:
    """Who has lately heard whom."""

    def __init__(self, robots: dict[str, int], addresses: dict[int, str]) -> None:
        """`robots`: the number of each; `addresses`: robots by their short addresses."""
        self._robots = robots
        self._senders = {address: robots[robot] for address, robot in addresses.items() if robot in robots}
        self._heard: dict[tuple[int, int], int] = {}

    def take(self, robot: str, received: Received) -> None:
        """Take in what a transceiver had to say."""
        own = self._robots.get(robot)
        for event in received.events:
            if isinstance(event, Heard) and own is not None and event.sender in self._senders:
                pair = (min(own, self._senders[event.sender]), max(own, self._senders[event.sender]))
                self._heard[pair] = max(event.instant, self._heard.get(pair, 0))

    def lately(self, instant: int) -> tuple[tuple[int, int], ...]:
        """Those of the last LINK_S, by number."""
        oldest = instant - round(LINK_S * 1e6)
        self._heard = {pair: heard for pair, heard in self._heard.items() if heard >= oldest}
        newest = sorted(self._heard, key=lambda pair: (-self._heard[pair], pair))[:LINKS]
        return tuple(sorted(newest))


def _brief(value: float) -> float:
    """To the millimetre, for messages of many robots are long."""
    return round(value, 3)
