"""Messages between actors, and the topics that carry them.

A message is encoded as one version byte and a msgpack array of its fields in the order declared here.
Keys: `swarm/up/<id>/…` from a robot, `swarm/down/<id>/…` to a robot, `swarm/infra/…` between other actors.
Instants are microseconds of simulated time; positions are metres in the map frame, angles radians.
"""

from typing import Annotated, Any, ClassVar, Final

import msgspec

from actors.geometry import Coordinate
from actors.ieee802154 import MAC_OCTETS, PSDU_LIMIT
from actors.introspection import Introspection
from actors.items import ItemGivenUp, ItemKey
from actors.orders import Order
from actors.topic import Message, MessagePart, Topic

MESSAGE_VERSION: Final = 4
FRAME_DATA_LIMIT: Final = PSDU_LIMIT - MAC_OCTETS
"""Most data bytes of a radio frame, 118: a PSDU without MAC header and FCS."""
MOST_FRAMES: Final = 32
"""Most frames of one robot per step; own choice: at 250 kbit/s a step of 0.1 s has airtime for about as many
frames of 80 bytes."""
TOO_WEAK: Final = -(2**15)
"""Signal strength, int16, of a copy too weak to be received."""
NO_ECHO_MM: Final = 0xFFFF
"""Range, uint16 mm, of a ray without an echo within the sensor's range."""


Charge = Annotated[float, msgspec.Meta(ge=0, le=1)]
"""Share of a battery's capacity that is left."""


class Ready(Message, frozen=True):
    """`actor` is ready for its first step: `step` is 0, or the step of a restart."""

    actor: str
    epoch: int
    kernels: str
    """Fingerprints of its numeric kernels (`actors.runtime.processor.combine_fingerprints`)."""


class Odometry(MessagePart, frozen=True):
    """Pose since the base was switched on, in the frame of its first pose; velocity in the body frame."""

    x: Coordinate
    y: Coordinate
    heading: Coordinate
    vx: Coordinate
    vy: Coordinate
    omega: Coordinate


class Scan(MessagePart, frozen=True):
    """One scan of the range sensor; the robot's model file has the ray directions."""

    stamp: int
    ranges_mm: bytes
    """uint16 little-endian, one per ray, mm; NO_ECHO_MM: no echo within range."""


class SensorData(Message, frozen=True):
    """Sensor data of one robot's base at the start of the step."""

    omissible: ClassVar[int] = 2
    instant: int
    events: int
    """Number of events in this step's RadioEvents for this robot; 0: no RadioEvents is sent."""
    odometry: Odometry
    bumper: int
    """Pressed bumpers: bit 0 right, 1 centre, 2 left."""
    scan: Scan | None = None
    """Latest scan completed since the last step, if any; scans have the sensor's own rate."""
    halt: bool = False
    """Last message to this process; no answer is expected."""
    earlier_scans: tuple[Scan, ...] = ()
    """Scans completed before `scan` since the last step, oldest first: the sensor may outpace the steps."""
    items: tuple[Any, ...] = ()
    """Items that the task, an event or an order gave to the robot, of the task's item type. A restarted robot
    receives all items given since the start."""
    battery: Charge | None = None
    """Charge of the battery; None: not simulated, or not known."""


class Drive(Message, frozen=True):
    """One robot's answer to SensorData: commanded velocity and progress of its work."""

    vx: Coordinate
    vy: Coordinate
    omega: Coordinate
    transmits: Annotated[int, msgspec.Meta(ge=0, le=MOST_FRAMES)]
    """Number of frames in this step's Transmit; 0: no Transmit is sent."""
    reports: tuple[Any, ...] = ()
    """Reports of the task's own type."""
    given_up: tuple[ItemGivenUp, ...] = ()
    route: tuple[ItemKey, ...] | None = None
    """Planned order of items; None: as last reported, initially the items given at the start."""
    pose: tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Pose estimate at the start of the step: x, y, heading, map frame; for recordings, observers and
    measurements only. None: unknown."""


class OutgoingFrame(MessagePart, frozen=True):
    """One frame to be broadcast."""

    tag: int
    """Chosen by the robot, unique across its epochs; repeated in the event that ends the transmission."""
    instant: int
    """Time at which the robot passes the frame to its transceiver; within the step."""
    data: bytes
    """At most FRAME_DATA_LIMIT bytes; may be empty (IEEE 802.15.4-2006, 7.2.2.2)."""


class Transmit(Message, frozen=True):
    """All frames that one robot passes to its transceiver during the step, in order."""

    frames: tuple[OutgoingFrame, ...]


class FrameReceived(MessagePart, frozen=True, tag="heard"):
    """A frame received by the robot's transceiver; `instant` is the end of its last symbol."""

    instant: int
    sender: int
    """The sender's short address (IEEE 802.15.4)."""
    rssi_dbm: float
    lqi: int
    data: bytes


class FrameSent(MessagePart, frozen=True, tag="sent"):
    """The frame `tag` was sent."""

    instant: int
    tag: int


class AccessFailure(MessagePart, frozen=True, tag="access_failure"):
    """The frame `tag` was dropped because the channel was never clear."""

    instant: int
    tag: int


class FrameOverflow(MessagePart, frozen=True, tag="overflow"):
    """The frame `tag` was dropped because the transceiver's transmit queue was full."""

    instant: int
    tag: int


class FrameRefused(MessagePart, frozen=True, tag="refused"):
    """The frame `tag` was rejected; `reason` is one sentence."""

    instant: int
    tag: int
    reason: str


class FrameUnconfirmed(MessagePart, frozen=True, tag="unconfirmed"):
    """The frame `tag` was passed to a radio board that did not confirm it. Hardware only."""

    instant: int
    tag: int


RadioEvent = FrameReceived | FrameSent | AccessFailure | FrameOverflow | FrameRefused | FrameUnconfirmed


class RadioEvents(Message, frozen=True):
    """All events of a robot's transceiver up to the start of the step, in order of time."""

    events: tuple[RadioEvent, ...]


class RobotTruth(MessagePart, frozen=True):
    """Ground truth of one robot at the start of the step: pose and velocity in the map frame, state."""

    id: str
    x: Coordinate
    y: Coordinate
    heading: Coordinate
    vx: Coordinate
    vy: Coordinate
    omega: Coordinate
    stepping: bool
    """False: frozen or exited; it does not take part in this step."""
    powered: bool
    """False: its transceiver is off."""
    transmits: int
    epoch: int = 0
    """Boot epoch of its process; the transceiver starts each epoch without earlier frames or events."""


class Jam(MessagePart, frozen=True):
    """A jammer: nothing is received within `radius` of it until the instant `until`."""

    x: Coordinate
    y: Coordinate
    radius: Annotated[float, msgspec.Meta(gt=0, le=1e6)]
    until: Annotated[int, msgspec.Meta(ge=0, le=9 * 10**15)]
    """The limit keeps the radio's nanoseconds within 64 bits."""


class Loss(MessagePart, frozen=True):
    """Loss of the next frame of `sender` that `robot` would have received."""

    robot: str
    sender: str


class PersonTruth(MessagePart, frozen=True):
    """Ground truth of one person at the start of the step: position and velocity in the map frame."""

    x: Coordinate
    y: Coordinate
    vx: Coordinate
    vy: Coordinate


class Truth(Message, frozen=True):
    """Ground truth at the start of the step, for the radio and observers."""

    omissible: ClassVar[int] = 3
    instant: int
    robots: tuple[RobotTruth, ...]
    """In scenario order."""
    jams: tuple[Jam, ...] = ()
    """Jammers switched on at the start of this step."""
    halt: bool = False
    """Last message to the radio; no answer is expected."""
    losses: tuple[Loss, ...] = ()
    """Losses ordered at the start of this step."""
    charges: tuple[Charge | None, ...] = ()
    """Charge of each robot's battery, None: not simulated; empty if no robot has one."""
    people: tuple[PersonTruth, ...] = ()
    """In a fixed order."""


class EventCount(MessagePart, frozen=True):
    """Number of events in one robot's next RadioEvents."""

    id: str
    events: int


class RadioAdvanced(Message, frozen=True):
    """The radio has simulated the medium up to the end of the step."""

    omissible: ClassVar[int] = 1
    counts: tuple[EventCount, ...]
    """Only robots with at least one event."""
    airtimes_ns: tuple[Annotated[int, msgspec.Meta(ge=0, le=10**9)], ...] = ()
    """Airtime of each robot's frames that ended in the step, in the order of Truth; empty unless Truth has
    charges."""


class Control(Message, frozen=True):
    """Orders from a person or a tool, applied at the next step boundary and recorded. `step` is not used."""

    orders: tuple[Order, ...]
    ticket: str = ""
    """Chosen by the sender, repeated in OrderOutcomes."""


class OrderOutcomes(Message, frozen=True):
    """Outcome of the orders of one Control; for display, outside barrier and digest."""

    ticket: str
    refusals: tuple[str, ...]
    """One sentence per refused order, in order."""


class ProcessOrder(MessagePart, frozen=True):
    """Request to start a robot's process."""

    robot: str
    epoch: int


class Roster(Message, frozen=True):
    """The world requests that the launcher start robot processes at this step."""

    start: tuple[ProcessOrder, ...]


class Progress(Message, frozen=True):
    """Progress of the run; for display, outside barrier and digest."""

    instant: int
    left: int
    """Number of items of the task that participating robots plan to do."""
    done: int
    """Number of items reported as done."""
    finished: bool
    paused: bool = False
    awaited: tuple[str, ...] = ()
    """During a wait: ids of the robots, or "radio", whose messages are missing."""
    awaits: str = ""
    """Missing message of the first of them, as text."""
    starting: bool = False
    """The world waits for actors that are starting."""
    held: tuple[str, ...] = ()
    """Hardware only: why the base does not, or soon will not, drive as commanded, as text."""


class LinkState(MessagePart, frozen=True, tag="link"):
    """Connection state of the radio board; `cause`: why it is down, empty while it is up."""

    instant: int
    up: bool
    cause: str


class GpsFix(MessagePart, frozen=True, tag="fix"):
    """Position from the board's GPS module, degrees, north and east positive; None: unknown."""

    instant: int
    valid: bool
    latitude: float | None
    longitude: float | None


class Temperature(MessagePart, frozen=True, tag="temperature"):
    """Temperature, degrees Celsius; not `valid` if the sensor is missing or its reading implausible."""

    instant: int
    celsius: float
    valid: bool


class Humidity(MessagePart, frozen=True, tag="humidity"):
    """Relative humidity, percent; `valid` as in Temperature."""

    instant: int
    percent: float
    valid: bool


class BoardText(MessagePart, frozen=True, tag="info"):
    """Text that the board sent when its button was pressed."""

    instant: int
    text: str


BoardNote = LinkState | GpsFix | Temperature | Humidity | BoardText
"""Reports of a radio board other than radio events."""


class Board(Message, frozen=True):
    """Reports of a radio board, for display, outside the barrier. `step` is not used."""

    notes: tuple[BoardNote, ...]


class FrameOutcome(MessagePart, frozen=True):
    """Outcome of one frame at the sender and at the other transceivers.

    Robots are indices into the radio's set-up. A transceiver that is not listed was on, and the frame was too
    weak there to be received.
    """

    sender: int
    tag: int
    """As in OutgoingFrame."""
    handed: int
    """Time at which the transceiver got the frame."""
    ended: int
    """Time at which it was sent or dropped."""
    size: int
    """Data bytes."""
    end: str
    """`sent`, `access_failure` or `overflow`."""
    receivers: bytes
    """uint16 little-endian, one per listed transceiver; empty for a frame that was not sent."""
    outcomes: bytes
    """uint8, one per listed transceiver: `actors.radio.medium.state.Outcome`."""
    strengths: bytes
    """int16 little-endian, one per listed transceiver: signal strength, 0.1 dBm, or TOO_WEAK."""


class FrameOutcomes(Message, frozen=True):
    """Frames that ended since the last message, up to the end of the step, in order of time."""

    frames: tuple[FrameOutcome, ...]


class UnmappedObstacle(MessagePart, frozen=True):
    """An obstacle that is not on the map, as bodies and rays meet it."""

    number: int
    """Number of the obstacle in the run, from 0."""
    kind: str
    """`wall`, `obstacle`, `closed door`, or `closing door` (waits until no robot is in it)."""
    points: tuple[tuple[float, float], ...]
    """m; the centre if round, both ends if straight."""
    radius: float
    """m; half the thickness if straight."""


class FloorChanged(Message, frozen=True):
    """Obstacles placed and removed at the start of the step; sent in step 0 even without changes."""

    put: tuple[UnmappedObstacle, ...] = ()
    gone: tuple[int, ...] = ()
    """Numbers of removed obstacles."""


class ItemMark(MessagePart, frozen=True):
    """State of an item of the task, for display."""

    owner: str
    number: int
    """As in ItemKey."""
    x: Coordinate
    y: Coordinate
    state: str
    """A key of `TaskDeclaration.marks`; empty: the item is no longer shown."""
    by: str = ""
    """Robot that is responsible for the state; empty: none."""

    @property
    def key(self) -> ItemKey:
        """Key of the item."""
        return ItemKey(self.owner, self.number)


class TaskEvent(MessagePart, frozen=True):
    """Event of a robot in its task, for display."""

    robot: str
    instant: int
    kind: str
    """A key of `TaskDeclaration.events`, or of `TaskDeclaration.causes`, which begins there; empty: the cause
    ends."""
    owner: str = ""
    number: int = 0
    """Key of the item concerned; without owner: none."""
    text: str = ""
    """Additional words."""

    @property
    def key(self) -> ItemKey | None:
        """Key of the item concerned; None: none."""
        return ItemKey(self.owner, self.number) if self.owner else None


class TaskChanged(Message, frozen=True):
    """Changes of the task up to the start of the step, by its judge."""

    marks: tuple[ItemMark, ...] = ()
    events: tuple[TaskEvent, ...] = ()


READY: Final = Topic("swarm/up/{id}/ready", Ready)
SENSES: Final = Topic("swarm/down/{id}/senses", SensorData, is_digested=True)
DRIVE: Final = Topic("swarm/up/{id}/drive", Drive, is_digested=True)
TRANSMIT: Final = Topic("swarm/up/{id}/transmit", Transmit, is_digested=True)
RECEIVED: Final = Topic("swarm/down/{id}/received", RadioEvents, is_digested=True)
RADIO_READY: Final = Topic("swarm/infra/ready", Ready)
TRUTH: Final = Topic("swarm/infra/truth", Truth, is_digested=True)
AIRED: Final = Topic("swarm/infra/aired", RadioAdvanced, is_digested=True)
CONTROL: Final = Topic("swarm/infra/control", Control, is_from_outside=True)
ROSTER: Final = Topic("swarm/infra/roster", Roster, is_digested=True)
PROGRESS: Final = Topic("swarm/infra/progress", Progress, is_telemetry=True)
FLOOR_NEWS: Final = Topic("swarm/infra/floor", FloorChanged, is_telemetry=True)
TASK_NEWS: Final = Topic("swarm/infra/task", TaskChanged, is_telemetry=True)
ANSWERED: Final = Topic("swarm/infra/answered", OrderOutcomes, is_telemetry=True)
BOARD: Final = Topic("swarm/infra/board", Board)
INTROSPECTION: Final = Topic(
    "swarm/up/{id}/introspection", Introspection, is_recorded_only=True, is_packed=False
)
FRAME_OUTCOMES: Final = Topic("swarm/infra/frame_outcomes", FrameOutcomes, is_recorded_only=True)
FLOOR_CHANGED: Final = Topic("swarm/infra/floor_changed", FloorChanged, is_recorded_only=True)
TASK_CHANGED: Final = Topic("swarm/infra/task_changed", TaskChanged, is_recorded_only=True)

TOPICS: Final[tuple[Topic[Message], ...]] = tuple(one for one in globals().values() if isinstance(one, Topic))
