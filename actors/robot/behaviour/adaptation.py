"""What a robot is told about its adaptation: the strategy's settings, the exchange of knowledge, areas.

Scenario and fleet files hold the same tables.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final

from pydantic import BeforeValidator, FailFast, Field, PlainValidator

from actors import table_wording
from actors.floor.placement import Area
from actors.instant import in_seconds, seconds
from actors.robot.behaviour.ports import EVERYBODY_DBM, ExchangeSettings, Setting
from actors.runtime.errors import AcrcError
from actors.table import Right, Span, Table, Text, as_tuples

BYTES_LIMIT: Final = 4_000_000
"""Size of the file; what the largest scenario file leads to is smaller."""
SHORTEST_S: Final = 0.001
"""Least interval in [deeco], s."""
LONGEST_S: Final = 1_000_000
"""Longest interval in [deeco], s."""
MOST_HOPS: Final = 15
"""Largest hop_limit in [deeco]."""
WEAKEST_DBM: Final = -90
"""Least relay_below in [deeco]: transceivers tell nothing weaker apart (`actors.radio.signal_codes`)."""
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


class DeecoTable(Table):
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


class AreaTable(Table):
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


class AdaptationFile(Table):
    """adaptation.toml as it stands; each table may be absent."""

    strategy: Settings = Field(default_factory=dict)
    deeco: DeecoTable = DeecoTable()
    area: Annotated[tuple[AreaTable, ...], FailFast(), BeforeValidator(as_tuples)] = ()


class AdaptationError(AcrcError):
    """A file of a robot's adaptation that cannot be used."""


@dataclass(frozen=True)
class Adaptation:
    """The content of adaptation.toml; each table may be absent."""

    settings: Mapping[str, Setting] = field(default_factory=dict)
    """[strategy]: the strategy's settings."""
    exchange: ExchangeSettings = field(default_factory=ExchangeSettings)
    """[deeco], the intervals in s."""
    areas: tuple[Area, ...] = ()
    """[[area]] with name, x = [from, to] and y = [from, to] in m: where places lie; none: anywhere."""


def load_adaptation(path: Path) -> Adaptation:
    """What stands in a robot's adaptation.toml. Raises AdaptationError."""
    file = table_wording.load(path, AdaptationFile, "adaptation", AdaptationError, BYTES_LIMIT)
    return _adaptation(file)


def adaptation(text: str) -> Adaptation:
    """What the text of an adaptation.toml says. Raises AdaptationError."""
    return _adaptation(table_wording.parse(text, AdaptationFile, AdaptationError))


def _adaptation(file: AdaptationFile) -> Adaptation:
    return Adaptation(file.strategy, file.deeco.settings, tuple(table.area for table in file.area))
