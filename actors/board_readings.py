"""What a radio board tells beside radio: parts of the message `Board`."""

from actors.topic import Part


class LinkState(Part, frozen=True, tag="link"):
    """The board has been set up, or must be found again; `cause` says why, "" = it is up."""

    instant: int
    up: bool
    cause: str


class Fix(Part, frozen=True, tag="fix"):
    """Where the board's GPS module holds it to be, degrees, north and east positive; None = unknown."""

    instant: int
    valid: bool
    latitude: float | None
    longitude: float | None


class Temperature(Part, frozen=True, tag="temperature"):
    """Degrees Celsius; not `valid` where the sensor is missing or talks nonsense."""

    instant: int
    celsius: float
    valid: bool


class Humidity(Part, frozen=True, tag="humidity"):
    """Relative, percent; `valid` as in Temperature."""

    instant: int
    percent: float
    valid: bool


class Info(Part, frozen=True, tag="info"):
    """What the board said of itself when its button was pressed."""

    instant: int
    text: str


BoardNote = LinkState | Fix | Temperature | Humidity | Info
