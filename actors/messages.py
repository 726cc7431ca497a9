"""Every message between actors and every key it travels on.

On the wire a message is one version byte followed by a msgpack array of the fields in the order declared
here. Keys: `swarm/up/<id>/…` from a robot, `swarm/down/<id>/…` to it, `swarm/infra/…` between the others.
All instants are microseconds of the run's time; positions are metres in the map frame, angles radians.
"""

from typing import Annotated, ClassVar, Final

import msgspec

from actors.board_readings import BoardNote
from actors.geometry import Coordinate
from actors.ieee802154 import MAC_OCTETS, PSDU_LIMIT
from actors.introspection import Introspection
from actors.orders import Order
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport
from actors.topic import Message, MessagePart, Topic

MESSAGE_VERSION: Final = 4
FRAME_DATA_LIMIT: Final = PSDU_LIMIT - MAC_OCTETS
"""Data bytes of one radio frame, 118: what MAC header and FCS leave of a PSDU."""
MOST_FRAMES: Final = 32
"""Frames of one robot in one step; own choice: at 250 kbit/s a step of 0.1 s has air time for about as many
of 80 bytes."""
TOO_WEAK: Final = -(2**15)
"""The strength of a copy, int16, that arrived too weakly to be followed."""
NO_ECHO_MM: Final = 0xFFFF
"""The range on the wire, uint16 mm, of a ray that met nothing within the sensor's range."""


# --- readiness ---------------------------------------------------------------------------------------------


class Ready(Message, frozen=True):
    """`actor` can take its first step. `step` is the step it is ready for (0, or that of a restart)."""

    actor: str
    epoch: int
    kernels: str
    """The fingerprints of what the actor computes with (`actors.runtime.processor.combined`)."""


# --- world and robot ---------------------------------------------------------------------------------------


class Odometry(MessagePart, frozen=True):
    """Pose since the base was switched on, in the frame of its first pose; velocity in the body's frame."""

    x: Coordinate
    y: Coordinate
    heading: Coordinate
    vx: Coordinate
    vy: Coordinate
    omega: Coordinate


class Scan(MessagePart, frozen=True):
    """One sweep of the robot's range sensor; where the rays point stands in the robot's model file."""

    stamp: int
    ranges_mm: bytes
    """uint16 little-endian, one per ray, mm; NO_ECHO_MM = nothing within range."""


class Senses(Message, frozen=True):
    """What the base of one robot sensed at the step's start."""

    omissible: ClassVar[int] = 1
    instant: int
    events: int
    """How many events Received carries for this robot and step; 0 = no such message is sent."""
    odometry: Odometry
    bumper: int
    """Bit 0 right, 1 centre, 2 left."""
    scan: Scan | None = None
    """The last sweep since the last step; absent where none ended: sweeps have the sensor's own rate."""
    halt: bool = False
    """The last message to this process: no answer is expected."""
    earlier_scans: tuple[Scan, ...] = ()
    """The sweeps before `scan` since the last step, oldest first: a sensor may be faster than the steps."""
    places: tuple[tuple[Coordinate, Coordinate], ...] = ()
    """Places that the robot is given from now on, m, map frame, beside those that it has: by an event of the
    scenario, or by a person's order. To a new process of the robot all those that came since the start."""


class Drive(Message, frozen=True):
    """One robot's answer to Senses: the velocity it wants from now on, and how its work stands."""

    vx: Coordinate
    vy: Coordinate
    omega: Coordinate
    transmits: Annotated[int, msgspec.Meta(ge=0, le=MOST_FRAMES)]
    """How many frames Transmit carries in this step; 0 = no such message is sent."""
    reports: tuple[PlaceReport, ...] = ()
    given_up: tuple[PlaceGivenUp, ...] = ()
    route: tuple[PlaceKey, ...] | None = None
    """The places that the robot still means to visit, in their order; None: as it last said, and before its
    first word, those that it was given."""
    pose: tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Where the robot held itself to be at the step's start: x, y, heading, map frame. For the record, for
    observers and to measure; nobody steers by it. None: it does not know."""


# --- robot and radio ---------------------------------------------------------------------------------------


class Outgoing(MessagePart, frozen=True):
    """One frame to be broadcast."""

    tag: int
    """Chosen by the robot, and another one in every epoch; comes back in Sent, AccessFailure or Overflow."""
    instant: int
    """When the robot hands the frame to its transceiver; within the step."""
    data: bytes
    """At most FRAME_DATA_LIMIT bytes; a frame may also be without data (IEEE 802.15.4-2006, 7.2.2.2)."""


class Transmit(Message, frozen=True):
    """All frames that one robot hands to its transceiver during the step, in order."""

    frames: tuple[Outgoing, ...]


class Heard(MessagePart, frozen=True, tag="heard"):
    """A frame that the robot's transceiver received; `instant` is when its last symbol ended."""

    instant: int
    sender: int
    """The sender's short address (IEEE 802.15.4)."""
    rssi_dbm: float
    lqi: int
    data: bytes


class Sent(MessagePart, frozen=True, tag="sent"):
    """The frame `tag` has left the antenna."""

    instant: int
    tag: int


class AccessFailure(MessagePart, frozen=True, tag="access_failure"):
    """The frame `tag` was given up because the channel never was clear."""

    instant: int
    tag: int


class Overflow(MessagePart, frozen=True, tag="overflow"):
    """The frame `tag` was dropped because the transceiver's transmit queue was full."""

    instant: int
    tag: int


class Refused(MessagePart, frozen=True, tag="refused"):
    """The frame `tag` was not accepted; `reason` is one sentence."""

    instant: int
    tag: int
    reason: str


class Unconfirmed(MessagePart, frozen=True, tag="unconfirmed"):
    """Nobody knows whether the frame `tag` has left: a board had it and never said. Not in simulation."""

    instant: int
    tag: int


RadioEvent = Heard | Sent | AccessFailure | Overflow | Refused | Unconfirmed


class Received(Message, frozen=True):
    """Everything that a robot's transceiver had to say until the step's start, in order of its instants."""

    events: tuple[RadioEvent, ...]


# --- world and radio ---------------------------------------------------------------------------------------


class RobotTruth(MessagePart, frozen=True):
    """Where a robot truly is at the step's start, how it moves (map frame), and what it does."""

    id: str
    x: Coordinate
    y: Coordinate
    heading: Coordinate
    vx: Coordinate
    vy: Coordinate
    omega: Coordinate
    stepping: bool
    """False: frozen or ended; it takes no part in this step."""
    powered: bool
    """False: its transceiver is off."""
    transmits: int
    epoch: int = 0
    """Of its process: in a new epoch the transceiver begins empty, without a frame or event of the last."""


class Jam(MessagePart, frozen=True):
    """A jammer at a point: nothing is received within `radius` until the instant `until`."""

    x: Coordinate
    y: Coordinate
    radius: Annotated[float, msgspec.Meta(gt=0, le=1e6)]
    until: Annotated[int, msgspec.Meta(ge=0, le=9 * 10**15)]
    """In nanoseconds, as the radio counts, it fits 64 bits."""


class Loss(MessagePart, frozen=True):
    """A robot does not receive the next frame of another that it would have received."""

    robot: str
    sender: str


class Truth(Message, frozen=True):
    """The world's ground truth at the step's start, for the radio and for observers."""

    omissible: ClassVar[int] = 1
    instant: int
    robots: tuple[RobotTruth, ...]
    """In the order of the scenario."""
    jams: tuple[Jam, ...] = ()
    """Jammers that were switched on at this step's start."""
    halt: bool = False
    """The last message to the radio: no answer is expected."""
    losses: tuple[Loss, ...] = ()
    """Ordered at this step's start."""


class EventCount(MessagePart, frozen=True):
    """How many events the next Received of one robot carries."""

    id: str
    events: int


class Aired(Message, frozen=True):
    """The medium has been computed up to the step's end."""

    counts: tuple[EventCount, ...]
    """Robots with at least one event only."""


# --- control of a run --------------------------------------------------------------------------------------


class Control(Message, frozen=True):
    """Orders from a person or a tool; applied at the next step boundary and recorded. `step` is not used."""

    orders: tuple[Order, ...]
    ticket: str = ""
    """Chosen by whoever gives the orders and wants to hear what becomes of them: Answered carries it."""


class Answered(Message, frozen=True):
    """What has become of the orders of one Control; for people, outside barrier and digest."""

    ticket: str
    refusals: tuple[str, ...]
    """A sentence for each order that was not carried out, in their order; none: all were."""


class ProcessOrder(MessagePart, frozen=True):
    """A robot process is to be started."""

    robot: str
    epoch: int


class Roster(Message, frozen=True):
    """The world asks the swarm's parent to start robot processes at this step."""

    start: tuple[ProcessOrder, ...]


class Progress(Message, frozen=True):
    """How far the run is; for people, outside the barrier and outside the digest."""

    instant: int
    places_left: int
    """Places in the routes of the robots that take part."""
    reports: int
    finished: bool
    paused: bool = False
    awaited: tuple[str, ...] = ()
    """While no step is taken: the ids of the robots, or "radio", whose messages are missing; else nobody."""
    awaits: str = ""
    """What the first of them owes, in words; empty unless the world waits."""
    starting: bool = False
    """The world waits for actors that have only been started."""
    held: tuple[str, ...] = ()
    """On board: what keeps the base from driving as it is told, or soon will, in words."""


# --- what a radio board tells beside radio -----------------------------------------------------------------


class Board(Message, frozen=True):
    """News from a radio board, for people: outside the barrier. `step` is not used."""

    notes: tuple[BoardNote, ...]


# --- recorded only -----------------------------------------------------------------------------------------


class FrameOutcome(MessagePart, frozen=True):
    """What became of one frame, and of its copies at the other transceivers.

    Robots are numbers: their places in the radio's set-up. A transceiver that is not listed was on, and the
    frame arrived too weakly to be followed.
    """

    sender: int
    tag: int
    """As in Outgoing."""
    handed: int
    """When the transceiver was handed the frame."""
    ended: int
    """When it had left the antenna, or was given up."""
    size: int
    """Bytes of its data."""
    end: str
    """`sent`, `access_failure` or `overflow`."""
    receivers: bytes
    """uint16 little-endian, one per listed transceiver; none of a frame that was not sent."""
    outcomes: bytes
    """uint8, one per listed transceiver: `actors.radio.medium.state.Outcome`."""
    strengths: bytes
    """int16 little-endian, one per listed transceiver: how strongly it arrived, 0.1 dBm, or TOO_WEAK."""


class FrameOutcomes(Message, frozen=True):
    """The frames that ended since the last message and up to the end of the step, in order of time."""

    frames: tuple[FrameOutcome, ...]


class FloorThing(MessagePart, frozen=True):
    """Something on the floor beside its map, with the extent that bodies and rays meet."""

    number: int
    """Counts all things of a run, from 0."""
    kind: str
    """`wall`, `obstacle`, `closed door`, or `closing door`: it waits until no robot stands in it."""
    points: tuple[tuple[float, float], ...]
    """m: the middle of what is round, both ends of what is straight."""
    radius: float
    """m; of what is straight, half of its thickness."""


class FloorChanged(Message, frozen=True):
    """What was put on the floor at the step's start and what is gone.

    There is one in step 0, even if nothing has changed.
    """

    put: tuple[FloorThing, ...] = ()
    gone: tuple[int, ...] = ()
    """Numbers of things."""


READY: Final = Topic("swarm/up/{id}/ready", Ready)
SENSES: Final = Topic("swarm/down/{id}/senses", Senses, is_digested=True)
DRIVE: Final = Topic("swarm/up/{id}/drive", Drive, is_digested=True)
TRANSMIT: Final = Topic("swarm/up/{id}/transmit", Transmit, is_digested=True)
RECEIVED: Final = Topic("swarm/down/{id}/received", Received, is_digested=True)
RADIO_READY: Final = Topic("swarm/infra/ready", Ready)
TRUTH: Final = Topic("swarm/infra/truth", Truth, is_digested=True)
AIRED: Final = Topic("swarm/infra/aired", Aired, is_digested=True)
CONTROL: Final = Topic("swarm/infra/control", Control, is_from_outside=True)
ROSTER: Final = Topic("swarm/infra/roster", Roster, is_digested=True)
PROGRESS: Final = Topic("swarm/infra/progress", Progress, is_telemetry=True)
FLOOR_NEWS: Final = Topic("swarm/infra/floor", FloorChanged, is_telemetry=True)
ANSWERED: Final = Topic("swarm/infra/answered", Answered, is_telemetry=True)
BOARD: Final = Topic("swarm/infra/board", Board)
INTROSPECTION: Final = Topic(
    "swarm/up/{id}/introspection", Introspection, is_recorded_only=True, is_packed=False
)
FRAME_OUTCOMES: Final = Topic("swarm/infra/frame_outcomes", FrameOutcomes, is_recorded_only=True)
FLOOR_CHANGED: Final = Topic("swarm/infra/floor_changed", FloorChanged, is_recorded_only=True)

TOPICS: Final[tuple[Topic[Message], ...]] = (
    READY, SENSES, DRIVE, TRANSMIT, RECEIVED, RADIO_READY, TRUTH, AIRED, CONTROL, ROSTER, PROGRESS,
    FLOOR_NEWS, ANSWERED, BOARD, INTROSPECTION, FRAME_OUTCOMES, FLOOR_CHANGED,
)  # type: ignore[assignment]  # fmt: skip
