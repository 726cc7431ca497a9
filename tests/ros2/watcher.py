"""Watcher of a run by zenoh-ros2-sdk: `python -m tests.ros2.watcher PORT`.

Writes `ready`, then a line of JSON per message, and at the first scan the output of `zenoh-ros2 topic list`.
"""

import contextlib
import io
import json
import os
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

from zenoh_ros2_sdk import ROS2Subscriber, topic_cli
from zenoh_ros2_sdk.qos import QosDurability, QosProfile

from tests.ros2.sdk import sdk_session, use_own_definitions

TOPICS = {
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/acrc/r1/scan": "sensor_msgs/msg/LaserScan",
}


def plain(value: Any) -> Any:
    """Return a message as dictionaries and lists; infinite numbers as text."""
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
    found = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(found, list):
        return [plain(one) for one in found]
    return str(found) if isinstance(found, float) else found


def main(port: int) -> None:
    """Write messages until the end of standard input."""
    lock, has_scan, stream = threading.Lock(), threading.Event(), sys.stdout

    def tell(topic: str, content: Any) -> None:
        with lock:
            print(json.dumps([topic, content]), file=stream, flush=True)
        if topic.endswith("scan"):
            has_scan.set()

    with tempfile.TemporaryDirectory() as folder:
        use_own_definitions(Path(folder))
        sdk_session(port)
        for topic, kind in TOPICS.items():
            ROS2Subscriber(
                topic,
                kind,
                lambda message, topic=topic: tell(topic, plain(message)),
                router_port=port,
                domain_id=0,
                qos=QosProfile(durability=QosDurability.VOLATILE),
            )
        print("ready", flush=True)
        has_scan.wait()
        # of the same session: the library has one per process
        sys.argv = ["zenoh-ros2", "--router", f"127.0.0.1:{port}", "list", "-t"]
        with contextlib.redirect_stdout(io.StringIO()) as listed:
            topic_cli.main()
        tell("list", listed.getvalue().splitlines())
        sys.stdin.read()
    os._exit(0)  # threads of the library run on


if __name__ == "__main__":
    main(int(sys.argv[1]))
