"""A host's router: while it is open, the robots of this computer reach the world on another one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from actors.messages import READY
from actors.runtime.bus.zenoh_bus import open_session


class HostRouter:
    """What a host knows of its link to the world's router."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        """`robot`: any of its robots."""
        self._session = session
        self._publisher: Any = session.declare_publisher(READY.key(robot))

    @property
    def joined(self) -> bool:
        """True once the world hears what robots say here; before, it would be lost without a word."""
        return bool(self._publisher.matching_status.matching)

    @property
    def linked(self) -> bool:
        """True while there is a link to the world's router."""
        return bool(self._session.info.routers_zid())


@contextmanager
def open_host_router(
    config: zenoh.Config, robot: str, between: Callable[[], None] = lambda: None
) -> Iterator[HostRouter]:
    """The router of a host; see `open_session`."""
    with open_session(config, between=between) as session:
        yield HostRouter(session, robot)
