"""Zenoh session of a ROS 2 node: publishers, subscriptions, and the graph of other nodes.

A client of one router, or the router itself. It opens in the background and reconnects by itself, so nothing
here waits for the network. Queues are bounded; messages beyond are dropped, the oldest first, and counted.
"""

import os
import threading
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final, NamedTuple

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from actors.instant import Instant
from actors.runtime.isolation.rules import set_value
from firmware_bridge.ros2.message_types import InvalidMessageError, decode, type_hash
from firmware_bridge.ros2.names import (
    ALL_GRAPHS,
    NO_HASH,
    SENSOR_QOS,
    Attachment,
    Endpoint,
    EndpointKind,
    NodeIdentity,
    QosProfile,
    RmwZenohMapping,
    key_mapping,
    token_gid,
)
from firmware_bridge.ros2.settings import RouterLink

_RETRY_S: Final = 1.0
"""Delay between attempts to connect, s."""
_MAX_ENDPOINTS: Final = 4096
"""Maximum number of stored endpoints of the graph; own choice, ten times that of a TurtleBot 4 and tools."""
_CLOSE_TIMEOUT_S: Final = 1.0


class ReceivedSample(NamedTuple):
    """A publication as it arrived."""

    arrived: Instant
    payload: bytes
    type_hash: str
    """Type hash of the key; empty: not told."""
    attachment: Attachment | None

    def message(self, kind: str) -> Any:
        """Return its message. Raises InvalidMessageError."""
        expected = type_hash(kind)
        if self.type_hash not in {"", NO_HASH, expected}:
            raise InvalidMessageError(
                f"{kind}: the robot's definition differs from ours: type hash {self.type_hash[:80]}, "
                f"not {expected}"
            )
        return decode(self.payload, kind)


class Subscription:
    """Queue of a topic's publications."""

    def __init__(self, depth: int) -> None:
        self.dropped = 0
        """Number of publications that were not read in time."""
        self.publishers: Counter[bytes] = Counter()
        """Publications by identifier of their publisher; empty identifier: none attached."""
        self._queue: deque[ReceivedSample] = deque(maxlen=depth)

    def take(self) -> list[ReceivedSample]:
        """Return the queued publications, oldest first."""
        return [self._queue.popleft() for _ in range(len(self._queue))]

    def add(self, sample: ReceivedSample) -> None:
        """Queue a publication; drop the oldest one if the queue is full."""
        self.dropped += len(self._queue) == self._queue.maxlen
        gid = b"" if sample.attachment is None else sample.attachment.gid
        if gid in self.publishers or len(self.publishers) < _MAX_ENDPOINTS:
            self.publishers[gid] += 1
        self._queue.append(sample)


class TopicPublisher:
    """Publisher of one topic."""

    def __init__(self, endpoint: Endpoint, *, blocks: bool) -> None:
        self.endpoint = endpoint
        self.gid = b""
        """Its identifier in attachments; empty before the session is open."""
        self.sent = self.unsent = 0
        """Number of publications passed to Zenoh, and of those before the session was open."""
        self._blocks = blocks
        self._publisher: Any = None
        self._has_attachment = False

    def put(self, payload: bytes, stamp_ns: int) -> None:
        """Publish CDR bytes; `stamp_ns`: time since the Unix epoch, ns."""
        if self._publisher is None:
            self.unsent += 1
            return
        self.sent += 1
        attachment = Attachment(self.sent, stamp_ns, self.gid).encode() if self._has_attachment else None
        with suppress(zenoh.ZError):  # the session was closed meanwhile
            self._publisher.put(payload, attachment=attachment)

    def declare(self, session: zenoh.Session, key: str, gid: bytes, *, has_attachment: bool) -> None:
        """Declare it on an open session."""
        qos = QosProfile.decode(self.endpoint.qos)
        control = zenoh.CongestionControl.BLOCK if self._blocks else zenoh.CongestionControl.DROP
        if qos.transient_local:
            publisher: Any = declare_advanced_publisher(
                session, key, congestion_control=control, cache=CacheConfig(max_samples=qos.depth)
            )
        else:
            publisher = session.declare_publisher(key, congestion_control=control)
        self.gid, self._has_attachment, self._publisher = gid, has_attachment, publisher


class Ros2Session:
    """Session of one node; a context manager."""

    def __init__(
        self, link: RouterLink, node: str, now: Callable[[], Instant], *, serves: bool = False
    ) -> None:
        """Start to connect; `node`: name without namespace, `now`: clock of arrivals.

        `serves`: be the router if there is none at the endpoint, which is of this computer.
        """
        self._link, self._node, self._now = link, node, now
        self._names = key_mapping(link.bridge, link.domain)
        self._session: zenoh.Session | None = None
        self._lock = threading.RLock()
        self._waiting: list[Callable[[zenoh.Session], None]] = [self._declare_graph]
        """Declarations for a session that is not open yet."""
        self._kept: list[Any] = []
        """Declared entities, which end when they are deleted."""
        self._endpoints: dict[str, Endpoint] = {}
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._stopped = threading.Event()
        self._modes = ("client", "router") if serves else ("client",)
        self.is_router = False
        self.fault = "not connected yet"
        """Cause of a closed session; empty: it is open."""
        self.invalid_tokens = 0
        """Number of tokens of the graph that were invalid or too many."""
        threading.Thread(target=self._open, daemon=True).start()

    def __enter__(self) -> "Ros2Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def is_connected(self) -> bool:
        """True while there is a link to the router."""
        session = self._session
        return session is not None and (self.is_router or bool(session.info.routers_zid()))

    def fileno(self) -> int:
        """Descriptor that is readable after a publication has arrived; `acknowledge` resets it."""
        return self._wake

    def acknowledge(self) -> None:
        """Make the descriptor unreadable until the next publication."""
        with suppress(BlockingIOError):
            os.eventfd_read(self._wake)

    def endpoints(self) -> tuple[Endpoint, ...]:
        """Return all known publishers and subscriptions, including those of this session."""
        with self._lock:
            return tuple(self._endpoints.values())

    def tokens(self, timeout_s: float) -> list[str]:
        """Return the tokens of all domains and of both mappings.

        Raises TimeoutError: the router did not answer a query within `timeout_s`.
        """
        session, found = self._session, list[str]()
        if session is not None:
            for graph in ALL_GRAPHS:
                for reply in session.liveliness().get(graph, timeout=timeout_s):
                    if reply.ok is None:
                        raise TimeoutError
                    found.append(str(reply.ok.key_expr))
        return found[:_MAX_ENDPOINTS]

    def publisher_names(self, topic: str) -> dict[bytes, str]:
        """Return the nodes that publish a topic, by the identifier of `token_gid`."""
        with self._lock:
            found = [(token, one) for token, one in self._endpoints.items() if one.topic == topic]
        return {token_gid(token): one.node for token, one in found if one.kind is EndpointKind.PUBLISHER}

    def subscribe(
        self, topic: str, kind: str, qos: QosProfile = SENSOR_QOS, *, hidden: bool = False
    ) -> Subscription:
        """Subscribe to a fully qualified topic; publications with any type hash are queued.

        Those of this session are not received. `hidden`: the subscription is not part of the graph.
        """
        subscription = Subscription(qos.depth)
        names, now, wake = self._names, self._now, self._wake

        def arrive(sample: zenoh.Sample) -> None:
            attached = None if sample.attachment is None else Attachment.decode(sample.attachment.to_bytes())
            found = names.parse_key(str(sample.key_expr))
            subscription.add(ReceivedSample(now(), sample.payload.to_bytes(), found, attached))
            os.eventfd_write(wake, 1)

        def declare(session: zenoh.Session) -> None:
            key, origin = names.data_key(topic, kind, "*"), zenoh.Locality.REMOTE
            self._kept.append(session.declare_subscriber(key, arrive, allowed_origin=origin))
            if not hidden:
                self._declare_token(
                    session, self._endpoint(EndpointKind.SUBSCRIPTION, topic, kind, None, qos)
                )

        self._when_open(declare)
        return subscription

    def publisher(
        self,
        topic: str,
        kind: str,
        qos: QosProfile = SENSOR_QOS,
        *,
        declared_hash: str | None = None,
        blocks: bool = False,
    ) -> TopicPublisher:
        """Publish a fully qualified topic.

        `declared_hash`: type hash that a subscription declares; None: of the definition. `blocks`: `put`
        waits for a slow link instead of dropping the publication.
        """
        endpoint = self._endpoint(EndpointKind.PUBLISHER, topic, kind, declared_hash, qos)
        publisher = TopicPublisher(endpoint, blocks=blocks)

        def declare(session: zenoh.Session) -> None:
            key = self._names.data_key(topic, kind, endpoint.type_hash)
            gid = token_gid(self._declare_token(session, endpoint))
            publisher.declare(session, key, gid, has_attachment=self._names.has_attachments)

        self._when_open(declare)
        return publisher

    def close(self) -> None:
        """Close the session; wait at most `_CLOSE_TIMEOUT_S`."""
        self._stopped.set()
        with self._lock:
            session, self._session = self._session, None
        if session is not None:
            closing = threading.Thread(target=session.close, daemon=True)
            closing.start()
            closing.join(_CLOSE_TIMEOUT_S)

    def _open(self) -> None:
        while not self._stopped.is_set():
            faults = []
            for mode in self._modes:
                try:
                    session = zenoh.open(self._config(mode))
                except zenoh.ZError as error:
                    faults.append(str(error).partition(" at /")[0].strip())
                    continue
                with self._lock:
                    self._session, self.is_router, self.fault = session, mode == "router", ""
                    waiting, self._waiting = self._waiting, []
                    for declare in waiting:
                        declare(session)
                return
            self.fault = faults[0]
            self._stopped.wait(_RETRY_S)

    def _config(self, mode: str) -> zenoh.Config:
        config, is_router = zenoh.Config(), mode == "router"
        for key, value in {
            "mode": mode,
            "listen/endpoints" if is_router else "connect/endpoints": [self._link.router],
            "scouting/multicast/enabled": False,
            "timestamping/enabled": True,  # required by the cache of transient local publishers
            "scouting/gossip/enabled": is_router,  # nodes of rmw_zenoh find one another by it
        }.items():
            set_value(config, key, value)
        return config

    def _when_open(self, declare: Callable[[zenoh.Session], None]) -> None:
        with self._lock:
            if self._session is None:
                self._waiting.append(declare)
            else:
                declare(self._session)

    def _declare_graph(self, session: zenoh.Session) -> None:
        if isinstance(self._names, RmwZenohMapping):
            token = self._names.node_token(self._identity(session))
            self._kept.append(session.liveliness().declare_token(token))
        graph = session.liveliness().declare_subscriber(self._names.graph, self._on_token, history=True)
        self._kept.append(graph)

    def _declare_token(self, session: zenoh.Session, endpoint: Endpoint) -> str:
        """Declare the token of an endpoint and return it; empty: the mapping has none for us."""
        if not isinstance(self._names, RmwZenohMapping):
            return ""
        token = self._names.endpoint_token(self._identity(session), len(self._kept) + 1, endpoint)
        self._kept.append(session.liveliness().declare_token(token))
        return token

    def _on_token(self, sample: zenoh.Sample) -> None:
        token = str(sample.key_expr)
        with self._lock:
            if sample.kind == zenoh.SampleKind.DELETE:
                self._endpoints.pop(token, None)
                return
            endpoint = self._names.parse_token(token)
            if endpoint is None or len(self._endpoints) >= _MAX_ENDPOINTS:
                self.invalid_tokens += 1
            elif endpoint.kind in {EndpointKind.PUBLISHER, EndpointKind.SUBSCRIPTION}:
                self._endpoints[token] = endpoint

    def _identity(self, session: zenoh.Session) -> NodeIdentity:
        return NodeIdentity(str(session.info.zid()), self._link.domain, self._link.namespace, self._node)

    def _endpoint(
        self, kind: EndpointKind, topic: str, name: str, declared_hash: str | None, qos: QosProfile
    ) -> Endpoint:
        found = type_hash(name) if declared_hash is None else declared_hash
        return Endpoint(kind, "", "", topic, name, found, qos.encode())
