"""Keys and tokens of zenoh-bridge-ros2dds, which connects a robot whose nodes use DDS, such as a Create 3.

zenoh-ros2-sdk has none of these; its CDR and its session are used. Source: liveliness_mgt.rs of
eclipse-zenoh/zenoh-plugin-ros2dds: `@/<bridge>/@ros2_lv/<MP|MS>/<key>/<type>/<qos>` with § in place of /.
"""

from collections.abc import Callable
from typing import Any

from tests.ros2.sdk import sdk_session, sdk_type_hash


def _bridge_token(session: Any, direction: str, topic: str, kind: str, *, reliable: bool) -> str:
    """Return the token of a route; QoS: without key, reliability, volatile, keep last 10, type hash."""
    key, name = topic.strip("/").replace("/", "§"), kind.replace("/", "§")
    qos = f":{int(reliable)}:0:0,10:typehash={sdk_type_hash(kind)};"
    return f"@/{session.session_id}/@ros2_lv/{direction}/{key}/{name}/{qos}"


class BridgedPublisher:
    """A DDS publisher behind the bridge; like ROS2Publisher of the SDK."""

    def __init__(self, topic: str, msg_type: str, port: int, *, reliable: bool = True) -> None:
        self.session_mgr, self.msg_type = sdk_session(port), msg_type
        self.session_mgr.register_message_type(None, msg_type)
        token = _bridge_token(self.session_mgr, "MP", topic, msg_type, reliable=reliable)
        self._token = self.session_mgr.liveliness.declare_token(token)
        self._publisher = self.session_mgr.session.declare_publisher(topic.strip("/"))

    def publish(self, **fields: Any) -> None:
        """Publish a message, without attachment."""
        store = self.session_mgr.store
        self._publisher.put(bytes(store.serialize_cdr(store.types[self.msg_type](**fields), self.msg_type)))

    def close(self) -> None:
        """End it."""
        self._token.undeclare()
        self._publisher.undeclare()


class BridgedSubscriber:
    """A DDS subscriber behind the bridge; like ROS2Subscriber of the SDK."""

    def __init__(self, topic: str, msg_type: str, callback: Callable[[Any], None], port: int) -> None:
        session = sdk_session(port)
        session.register_message_type(None, msg_type)
        token = _bridge_token(session, "MS", topic, msg_type, reliable=True)
        self._token = session.liveliness.declare_token(token)

        def take(sample: Any) -> None:
            callback(session.store.deserialize_cdr(sample.payload.to_bytes(), msg_type))

        self._subscriber = session.session.declare_subscriber(topic.strip("/"), take)
