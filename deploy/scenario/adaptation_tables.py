"""What scenario and fleet files say about the robots' adaptation: their tables, and what robots are told."""

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Final

from pydantic import BeforeValidator, Field, PlainValidator

from actors.floor.placement import Area
from actors.instant import in_seconds, seconds
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.behaviour.ports import EVERYBODY_DBM, LONGEST_S, ExchangeSettings, Setting
from actors.table import FileTable, Right, Span, Text

SHORTEST_S: Final = 0.001
"""Least interval in [deeco], s."""
MOST_HOPS: Final = 15
"""Largest hop_limit in [deeco]."""
WEAKEST_DBM: Final = -90
"""Least relay_below in [deeco]: transceivers tell nothing weaker apart (`actors.radio.frame`)."""
MOST_ITEMS: Final = 1000
"""Of a list in [strategy]."""
_AS_IT_IS: Final = ExchangeSettings()


def _is_scalar(value: object) -> bool:
    """What TOML can hold and what has one value: no date, no table, no infinity."""
    match value:
        case bool() | str():
            return True
        case int():
            return -(2**63) <= value < 2**63
        case float():
            return math.isfinite(value)
    return False


def _is_setting(value: object) -> bool:
    if isinstance(value, list | tuple):
        return len(value) <= MOST_ITEMS and all(_is_scalar(item) for item in value)
    return _is_scalar(value)


def _setting(value: object) -> object:
    if not _is_setting(value):
        raise ValueError
    return tuple(value) if isinstance(value, list) else value


def _first_wrong(settings: object) -> object:
    """Of a million values that are wrong the first is enough."""
    if isinstance(settings, dict):
        for name, value in settings.items():
            if not _is_setting(value):
                return {name: value}
    return settings


Interval = Annotated[
    float,
    Field(ge=SHORTEST_S, le=LONGEST_S),
    Right(f"a number of seconds from {SHORTEST_S} to {LONGEST_S}"),
]
Settings = Annotated[
    Mapping[str, Annotated[Setting, PlainValidator(_setting)]],
    BeforeValidator(_first_wrong),
    Right(
        "a table [strategy] with the strategy's settings; its name stands in run.strategy",
        item=f"true, false, a whole number of 64 bits, a finite number, a text, or a list of at most"
        f" {MOST_ITEMS} of these",
    ),
]


class DeecoTable(FileTable):
    """[deeco]: how the nodes of the component model exchange knowledge by radio.

    What is absent is as `ExchangeSettings` has it.
    """

    publish: Interval = in_seconds(_AS_IT_IS.publish)
    """How often each robot publishes its knowledge, s (d3scomp/JDEECo, DefaultKnowledgePublisher)."""
    relay: bool = _AS_IT_IS.relay
    """Robots pass on what they hear; off in the original testbed."""
    hop_limit: Annotated[int, Field(ge=1, le=MOST_HOPS)] = _AS_IT_IS.hop_limit
    """How often knowledge is passed on at most."""
    relay_delay: Annotated[
        float, Field(ge=0, le=LONGEST_S), Right(f"a number of seconds from 0 to {LONGEST_S}")
    ] = in_seconds(_AS_IT_IS.relay_delay)
    """The longest wait before knowledge is passed on, that for the strongest signal, s."""
    relay_below: Annotated[
        float,
        Field(ge=WEAKEST_DBM, le=EVERYBODY_DBM),
        Right(f"a number of dBm from {WEAKEST_DBM} to {EVERYBODY_DBM:g}"),
    ] = _AS_IT_IS.relay_below_dbm
    """Who hears knowledge more strongly does not pass it on, dBm; at 0 everybody does."""
    forget: Interval = in_seconds(_AS_IT_IS.forget)
    """Replicas of robots that were not heard of for so long are dropped, s."""

    @property
    def settings(self) -> ExchangeSettings:
        """The same with its durations in µs."""
        return ExchangeSettings(
            publish=seconds(self.publish),
            relay=self.relay,
            hop_limit=self.hop_limit,
            relay_delay=seconds(self.relay_delay),
            relay_below_dbm=self.relay_below,
            forget=seconds(self.forget),
        )


class AreaTable(FileTable):
    """[[area]]: a rectangle of the floor that has a name."""

    name: Annotated[Text, Right('a name such as "hall"')]
    x: Span
    """From the west edge to the east edge, m."""
    y: Span
    """From the south edge to the north edge, m."""

    @property
    def area(self) -> Area:
        """The rectangle."""
        (x0, x1), (y0, y1) = self.x, self.y
        return Area(self.name, x0, y0, x1, y1)


def adaptation(settings: Settings, exchange: DeecoTable, areas: Iterable[AreaTable]) -> Adaptation:
    """What every robot is told of these tables."""
    return Adaptation(dict(settings), exchange.settings, tuple(table.area for table in areas))
