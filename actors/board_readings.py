"""What a radio board tells beside radio: parts of the message `Board`."""

from actors.topic import MessagePart


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
