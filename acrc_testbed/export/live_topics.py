"""Live ROS 2 topics of a run in progress, for `--ros2`: `python -m acrc_testbed.export.live_topics`.

A process of its own reads the recordings as they grow, like the live view. It subscribes to nothing, so no
publication of another node reaches a robot.
"""

import os
import sys
import threading
import time
from argparse import ArgumentParser
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

from acrc_testbed.export.log_export import robot_models
from acrc_testbed.export.robot_entries import RunEntries
from acrc_testbed.export.ros2_log import (
    CLOCK,
    ROBOT_TYPES,
    SHARED_TYPES,
    LogEntry,
    clock_entries,
    robot_topic,
    topic_qos,
    topic_type,
)
from acrc_testbed.recordings.run_recordings import recordings
from acrc_testbed.recordings.topics import is_closed
from acrc_testbed.run_model.data import RunData, RunDescription
from acrc_testbed.run_model.onboard_runs import OnboardReader
from acrc_testbed.run_model.simulated_runs import RunReader
from actors.instant import Instant
from actors.runtime.errors import AcrcError
from actors.runtime.linux import die_with_parent, exit_on_sigterm
from actors.runtime.recording import read_notes
from firmware_bridge.ros2.session import Ros2Session, TopicPublisher
from firmware_bridge.ros2.settings import RouterLink

_NICE: Final = 10
"""Niceness, so that the run has priority."""
_POLL_S: Final = 0.1
_SETTLING_S: Final = 0.5
"""Time for which recordings may still grow after the end of the run, s."""
_WHOLE_S: Final = 0.5
"""Longest part of a run that is published whole, s; own choice: five poll periods."""
_DEPTH: Final = 20
"""Queued messages per topic and robot: those of 2 s at ten steps per second."""
_DRAIN_S: Final = 2.0
"""Time for the last messages to be sent, s."""


class QueuedMessage(NamedTuple):
    """An encoded message that waits to be sent."""

    number: int
    topic: str
    payload: bytes


class TopicQueues:
    """Queues of messages, one per topic; a full one drops its oldest message."""

    def __init__(self, depths: Mapping[str, int]) -> None:
        self.dropped = Counter[str]()
        """Number of dropped messages by topic."""
        self._queues = {topic: deque[QueuedMessage](maxlen=depth) for topic, depth in depths.items()}
        self._changed = threading.Condition()
        self._number, self._is_closed = 0, False

    def add(self, topic: str, payload: bytes) -> None:
        """Queue a message; does not wait."""
        with self._changed:
            queue = self._queues[topic]
            self.dropped[topic] += len(queue) == queue.maxlen
            queue.append(QueuedMessage(self._number, topic, payload))
            self._number += 1
            self._changed.notify()

    def take(self) -> list[QueuedMessage]:
        """Wait for messages, remove and return them, oldest first; none: closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or any(self._queues.values()))
            taken = sorted(one for queue in self._queues.values() for one in queue)
            for queue in self._queues.values():
                queue.clear()
            return taken

    def close(self) -> None:
        """Let `take` return what is left, then nothing."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()


class LiveTopics:
    """Publishers of a run's topics; a reader that is slow delays neither the run nor its recordings."""

    def __init__(self, run: RunDescription, publish: Callable[[str, str], TopicPublisher]) -> None:
        """`publish`: returns the publisher of a topic and message type; `/clock` needs ground truth."""
        shared = [*SHARED_TYPES, *([CLOCK] if run.has_truth else [])]
        depths = dict.fromkeys(shared, _DEPTH * (len(run.robots) + 1))
        depths |= {robot_topic(robot, name): _DEPTH for robot in run.robots for name in ROBOT_TYPES}
        self._publishers = {topic: publish(topic, topic_type(topic)) for topic in depths}
        self.queues = TopicQueues(
            {topic: 1 if topic_qos(topic).transient_local else depth for topic, depth in depths.items()}
        )
        self.published = self.skipped = 0
        """Number of queued messages, and of those replaced by newer ones of the same part."""
        self._notes: dict[str, None] = {}
        self._entries: RunEntries | None = None
        self._sender = threading.Thread(target=self._send, daemon=True)
        self._sender.start()

    def add(self, run: RunData) -> None:
        """Queue the messages of the next part; of a long one, the newest of each topic.

        Raises RecordingError.
        """
        if self._entries is None:
            self._entries = RunEntries(run.description, robot_models(run, recordings(run.out)))
        self._notes |= dict.fromkeys(run.notes)
        entries: Iterable[LogEntry] = self._entries.take(run, run.senses)
        if run.description.has_truth:
            entries = chain(entries, clock_entries(run.seconds))
        if run.end - run.since > _WHOLE_S:
            entries = self._newest(entries)
        for one in entries:
            self.published += 1
            self.queues.add(one.topic, one.encode())

    def close(self) -> None:
        """Send the queued messages, within a time limit."""
        self.queues.close()
        self._sender.join(_DRAIN_S)

    def report(self) -> Iterator[str]:
        """Describe what was published and what was not, a sentence each."""
        yield f"ROS 2: {self.published} messages were published on {len(self._publishers)} topics"
        if self.skipped:
            yield f"ROS 2: {self.skipped} messages were skipped: the run is faster than they can be shown"
        for topic, count in sorted(self.queues.dropped.items()):
            if count:
                yield f"ROS 2: {topic}: {count} messages were dropped: a reader is slow"
        yield from self._notes

    def _newest(self, entries: Iterable[LogEntry]) -> list[LogEntry]:
        """Return the newest message of each topic and set of frames; all log lines."""
        newest: dict[Any, LogEntry] = {}
        for number, one in enumerate(entries):
            detail: Any = number if one.topic == "/rosout" else None
            if one.topic == "/tf":
                detail = tuple(frame.child_frame_id for frame in one.message.transforms)
            self.skipped += newest.pop((one.topic, detail), None) is not None
            newest[one.topic, detail] = one
        return [*newest.values()]

    def _send(self) -> None:
        while batch := self.queues.take():
            for _, topic, payload in batch:
                self._publishers[topic].put(payload, time.time_ns())  # waits for slow readers


def follow_run(reader: RunReader, topics: LiveTopics, has_ended: Callable[[], bool]) -> None:
    """Publish a growing run until it ends. Raises RecordingError or RunDataError for damaged recordings."""
    while not has_ended():
        if (run := reader.poll()) is None:
            time.sleep(_POLL_S)
        else:
            topics.add(run)
    time.sleep(_SETTLING_S)
    if (run := reader.poll(last=True)) is not None:
        topics.add(run)


def publish_run(out: Path, link: RouterLink, robot: str) -> None:
    """Publish a simulated run until it ends, or that of a `robot` on board until this process is terminated.

    Raises AcrcError for a missing or damaged run, or if there is no connection until its end.
    """
    first, name = (f"{robot}.base",) if robot else ("world", "radio"), f"acrc_{robot}".rstrip("_")
    files = [out / actor / f"{actor}.mcap" for actor in first]

    def has_ended() -> bool:
        return not robot and all(path.is_file() and is_closed(path) for path in files)

    with Ros2Session(link, name, lambda: Instant(time.time_ns() // 1000), serves=True) as session:
        while session.fault or not all(path.is_file() and "run" in read_notes(path) for path in files):
            if session.fault and has_ended():
                raise AcrcError(f"ROS 2: {link.router}: nothing was published: {session.fault}")
            time.sleep(_POLL_S)
        with OnboardReader(out, robot) if robot else RunReader(out, internals=True, senses=True) as reader:
            topics = LiveTopics(
                reader.description,
                lambda topic, kind: session.publisher(topic, kind, topic_qos(topic), blocks=True),
            )
            try:
                follow_run(reader, topics, has_ended)
            finally:
                topics.close()
                sys.stderr.writelines(f"{sentence}\n" for sentence in topics.report())


def main(argv: Sequence[str]) -> int:
    """Publish a run until it ends; return the exit code."""
    exit_on_sigterm()
    parser = ArgumentParser(prog="python -m acrc_testbed.export.live_topics")
    parser.add_argument("--out", type=Path, required=True, help="read the run in this folder")
    parser.add_argument("--router", required=True, help="endpoint of the Zenoh router")
    parser.add_argument("--domain", type=int, required=True, help="ROS_DOMAIN_ID")
    parser.add_argument("--robot", default="", help="read the run of this robot on board")
    options = parser.parse_args(argv)
    die_with_parent(os.getppid())
    os.nice(_NICE)
    try:
        link = RouterLink(router=options.router, domain=options.domain)
        publish_run(options.out, link, options.robot)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
