"""Connection to a ROS 2 robot: its session, topics and velocity commands."""

import os
from collections.abc import Callable, Sequence

from actors.instant import Instant
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.driver import Publications, RobotDriver
from firmware_bridge.ros2.names import resolve
from firmware_bridge.ros2.robot_clock import NO_TIME
from firmware_bridge.ros2.scan_reader import LaserScanReader
from firmware_bridge.ros2.session import Ros2Session, Subscription
from firmware_bridge.ros2.settings import Ros2Base
from firmware_bridge.ros2.velocity_commands import CommandPublisher, RivalDetector
from firmware_bridge.safety import HoldCause
from firmware_bridge.serial_port import Say, changed_only


def node_name(part: str, process: int) -> str:
    """Return the name of a node; `part`: base or guardian, `process`: PID of the base."""
    return f"acrc_{part}_{process}"


class RobotLink:
    """Session of a base process, which serves its driver and its reader of scans."""

    def __init__(
        self,
        session: Ros2Session,
        base: Ros2Base,
        driver: RobotDriver,
        scans: LaserScanReader,
        take: Callable[[Instant, Publications], None],
        now: Callable[[], Instant],
        say: Say,
    ) -> None:
        """Create it; `take`: passes messages to the driver, `now`: clock of arrivals."""
        names = [node_name(part, os.getpid()) for part in ("base", "guardian")]
        self._session, self._base, self._driver = session, base, driver
        self._scans, self._take = scans, take
        self._now, self._say = now, changed_only(say)
        self._topics = {
            name: self._session.subscribe(base.topic(name), kind)
            for name, kind in message_types.TOPIC_TYPES.items()
        }
        command = base.topic("command")
        self._commands: list[Subscription] = [
            self._session.subscribe(command, kind, hidden=True)
            for kind in message_types.COMMAND_TYPES.values()
        ]
        self._publisher = CommandPublisher(self._session, base)
        self._rivals = RivalDetector(base, [resolve(base.namespace, name) for name in names])

    @property
    def port(self) -> "RobotLink | None":
        """This link while commands reach the router, for the guardian."""
        return self if self._publisher.is_ready else None

    def descriptors(self) -> Sequence[int]:
        """Return the descriptor of arrivals."""
        return (self._session.fileno(),)

    def serve(self, now: Instant) -> None:
        """Pass received messages to the driver, and publish its velocity."""
        self._session.acknowledge()
        self._publisher.update(now)
        self._hold_causes(now)
        publications = {name: one.take() for name, one in self._topics.items()}
        self._scans.take(publications["scan"])
        self._take(now, publications)
        due = self._driver.due(now)
        if due is not None:
            self._publisher.put(now, due.v, due.omega, self._driver.clock.offset or NO_TIME)

    def close(self) -> None:
        """Publish a stop and close the session; the guardian repeats it until standstill."""
        self._publisher.put(self._now(), 0.0, 0.0, self._driver.clock.offset or NO_TIME)
        self._session.close()

    def _hold_causes(self, now: Instant) -> None:
        """Set or clear the causes that the graph shows."""
        commands = [sample for one in self._commands for sample in one.take()]
        names = self._session.publisher_names(self._base.topic("command"))
        rival = self._rivals.find(now, self._session.endpoints(), names, commands)
        refusal = self._publisher.refusal
        details = {HoldCause.OTHER_PUBLISHER: rival} if rival else {}
        if refusal is not None and self._session.is_connected:
            details[refusal.cause] = refusal.sentence
        for cause in (HoldCause.OTHER_PUBLISHER, HoldCause.NO_SUBSCRIBER, HoldCause.COMMAND_TYPE):
            self._driver.hold(cause, cause in details)
        self._driver.details = details
        fault = "" if self._session.is_connected else self._session.fault or "connection lost"
        sentences = [f"{self._base.router}: {fault}"] if fault else []
        sentences += [f"{cause.value}: {text}" for cause, text in details.items()]
        self._say("; ".join(sentences))
