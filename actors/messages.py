"""Every message between actors and every key it travels on.

On the wire a message is one version byte followed by a msgpack array of the fields in the order declared
here. Keys: `swarm/up/<id>/…` from a robot, `swarm/down/<id>/…` to it, `swarm/infra/…` between the others.
All instants are microseconds of the run's time; positions are metres in the map frame, angles radians.
"""

from typing import Annotated, ClassVar, Final

import msgspec

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


class Ready(Message, frozen=True):
    """`actor` can take its first step: `step`, 0 or that of a restart."""

    actor: str
    epoch: int
    kernels: str
    """Fingerprints of its numeric kernels (`actors.runtime.processor.combined`)."""


class Odometry(MessagePart, frozen=True):
    """Pose since the base was switched on, in the frame of its first pose; velocity in the body's frame."""

    x: Coordinate
    y: Coordinate
    heading: Coordinate
    vx: Coordinate
    vy: Coordinate
    omega: Coordinate


class Scan(MessagePart, frozen=True):
    """One sweep of the robot's range sensor; the robot's model file has the directions of the rays."""

    stamp: int
    ranges_mm: bytes
    """uint16 little-endian, one per ray, mm; NO_ECHO_MM = nothing within range."""


class Senses(Message, frozen=True):
    """Sensor data of one robot's base at the step's start."""

    omissible: ClassVar[int] = 1
    instant: int
    events: int
    """Events in Received for this robot and step; 0: no such message is sent."""
    odometry: Odometry
    bumper: int
    """Bit 0 right, 1 centre, 2 left."""
    scan: Scan | None = None
    """The last sweep that ended since the last step, if any: sweeps have the sensor's own rate."""
    halt: bool = False
    """The last message to this process: no answer is expected."""
    earlier_scans: tuple[Scan, ...] = ()
    """The sweeps before `scan` since the last step, oldest first: a sensor may be faster than the steps."""
    places: tuple[tuple[Coordinate, Coordinate], ...] = ()
    """Further places of the robot from now on, m, map frame, by an event of the scenario or an order. To a
    new process of the robot all those since the start."""


class Drive(Message, frozen=True):
    """One robot's answer to Senses: the commanded velocity, and the progress of its work."""

    vx: Coordinate
    vy: Coordinate
    omega: Coordinate
    transmits: Annotated[int, msgspec.Meta(ge=0, le=MOST_FRAMES)]
    """Frames in Transmit in this step; 0: no such message is sent."""
    reports: tuple[PlaceReport, ...] = ()
    given_up: tuple[PlaceGivenUp, ...] = ()
    route: tuple[PlaceKey, ...] | None = None
    """The places that the robot plans to visit, in order; None: as last reported, at first those that it was
    given."""
    pose: tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Pose estimate at the step's start: x, y, heading, map frame; for recordings, observers and measurements
    only. None: unknown."""


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
    """The frame `tag` was dropped because the channel never was clear."""

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
    """The frame `tag` was given to a board, which did not confirm it. Not in simulation."""

    instant: int
    tag: int


RadioEvent = Heard | Sent | AccessFailure | Overflow | Refused | Unconfirmed


class Received(Message, frozen=True):
    """All events of a robot's transceiver until the step's start, in order of their instants."""

    events: tuple[RadioEvent, ...]


class RobotTruth(MessagePart, frozen=True):
    """Ground truth of a robot at the step's start: pose and velocity in the map frame, state."""

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


class Control(Message, frozen=True):
    """Orders from a person or a tool; applied at the next step boundary and recorded. `step` is not used."""

    orders: tuple[Order, ...]
    ticket: str = ""
    """Chosen by the sender; Answered repeats it."""


class Answered(Message, frozen=True):
    """Outcome of the orders of one Control; for people, outside barrier and digest."""

    ticket: str
    refusals: tuple[str, ...]
    """A sentence for each order that was refused, in order."""


class ProcessOrder(MessagePart, frozen=True):
    """A robot process is to be started."""

    robot: str
    epoch: int


class Roster(Message, frozen=True):
    """The world asks the swarm's parent to start robot processes at this step."""

    start: tuple[ProcessOrder, ...]


class Progress(Message, frozen=True):
    """Progress of the run; for people, outside barrier and digest."""

    instant: int
    places_left: int
    """Places in the routes of the robots that take part."""
    reports: int
    finished: bool
    paused: bool = False
    awaited: tuple[str, ...] = ()
    """While no step is taken: the ids of the robots, or "radio", whose messages are missing."""
    awaits: str = ""
    """The missing message of the first of them, in words."""
    starting: bool = False
    """The world waits for actors that have only been started."""
    held: tuple[str, ...] = ()
    """On board: why the base does not, or soon will not, drive as commanded, in words."""


class LinkState(MessagePart, frozen=True, tag="link"):
    """The board has been set up, or must be found again; `cause` says why, "" = it is up."""

    instant: int
    up: bool
    cause: str


class Fix(MessagePart, frozen=True, tag="fix"):
    """Where the board's GPS module holds it to be, degrees, north and east positive; None = unknown."""

    instant: int
    valid: bool
    latitude: float | None
    longitude: float | None


class Temperature(MessagePart, frozen=True, tag="temperature"):
    """Degrees Celsius; not `valid` where the sensor is missing or talks nonsense."""

    instant: int
    celsius: float
    valid: bool


class Humidity(MessagePart, frozen=True, tag="humidity"):
    """Relative, percent; `valid` as in Temperature."""

    instant: int
    percent: float
    valid: bool


class Info(MessagePart, frozen=True, tag="info"):
    """What the board said of itself when its button was pressed."""

    instant: int
    text: str


BoardNote = LinkState | Fix | Temperature | Humidity | Info
"""What a radio board reports beside radio."""


class Board(Message, frozen=True):
    """Reports of a radio board, for people: outside the barrier. `step` is not used."""

    notes: tuple[BoardNote, ...]


class FrameOutcome(MessagePart, frozen=True):
    """Outcome of one frame, and of its copies at the other transceivers.

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
    """An obstacle that is not on the map, with the extent that bodies and rays meet."""

    number: int
    """Counts all things of a run, from 0."""
    kind: str
    """`wall`, `obstacle`, `closed door`, or `closing door`: it waits until no robot stands in it."""
    points: tuple[tuple[float, float], ...]
    """m: the middle of what is round, both ends of what is straight."""
    radius: float
    """m; of what is straight, half of its thickness."""


class FloorChanged(Message, frozen=True):
    """Obstacles placed and removed at the step's start; sent in step 0 even without a change."""

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

TOPICS: Final[tuple[Topic[Message], ...]] = tuple(one for one in globals().values() if isinstance(one, Topic))
