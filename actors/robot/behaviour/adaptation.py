"""What a robot is told about its adaptation: the strategy's settings, the exchange of knowledge, areas."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Final, TypeGuard

from actors import toml_file
from actors.floor.placement import Area
from actors.instant import Duration, seconds
from actors.robot.behaviour.ports import ExchangeSettings, Setting
from actors.runtime.errors import AcrcError
from actors.wording import shown, unknown_key

BYTES_LIMIT: Final = 4_000_000
"""Size of the file; what the largest scenario file leads to is smaller."""
SHORTEST_S: Final = 0.001
"""Least interval in [deeco], s."""
LONGEST_S: Final = 1_000_000
"""Longest interval in [deeco], s."""
MOST_HOPS: Final = 15
"""Largest hop_limit in [deeco]."""


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
    text = toml_file.read(path, "adaptation", AdaptationError, BYTES_LIMIT)
    try:
        return adaptation(text)
    except AdaptationError as error:
        raise AdaptationError(f"{path}: {error}") from None


def adaptation(text: str) -> Adaptation:
    """What the text of an adaptation.toml says. Raises AdaptationError."""
    try:
        content = toml_file.loads(text)
    except ValueError as error:
        raise AdaptationError(f"this is no TOML: {error}") from None
    strategy, deeco, areas = content.pop("strategy", {}), content.pop("deeco", {}), content.pop("area", [])
    if content:
        raise AdaptationError(unknown_key("", next(iter(content)), ("strategy", "deeco", "area")))
    if not isinstance(strategy, dict):
        raise _wrong("strategy", strategy, "a table [strategy]")
    if not isinstance(deeco, dict):
        raise _wrong("deeco", deeco, "a table [deeco]")
    if not isinstance(areas, list):
        raise _wrong("area", areas, "a list of tables [[area]]")
    return Adaptation(
        settings={name: _setting(name, value) for name, value in strategy.items()},
        exchange=_exchange(deeco),
        areas=tuple(_area(f"area[{index}]", area) for index, area in enumerate(areas)),
    )


def _setting(name: str, value: object) -> Setting:
    if isinstance(value, bool | int | str) or (isinstance(value, float) and math.isfinite(value)):
        return value
    raise _wrong(f"strategy.{name}", value, "true, false, a finite number or a text")


def _exchange(table: Mapping[str, object]) -> ExchangeSettings:
    """[deeco]; what is absent is as ExchangeSettings has it."""
    settings = ExchangeSettings()
    for name, value in table.items():
        match name, value:
            case ("publish", _):
                settings = replace(settings, publish=_interval(name, value, SHORTEST_S))
            case ("relay", bool()):
                settings = replace(settings, relay=value)
            case ("relay", _):
                raise _wrong("deeco.relay", value, "true or false")
            case ("hop_limit", int()) if value is not True and 1 <= value <= MOST_HOPS:
                settings = replace(settings, hop_limit=value)
            case ("hop_limit", _):
                raise _wrong("deeco.hop_limit", value, f"a whole number from 1 to {MOST_HOPS}")
            case ("relay_delay", _):
                settings = replace(settings, relay_delay=_interval(name, value, 0))
            case ("forget", _):
                settings = replace(settings, forget=_interval(name, value, SHORTEST_S))
            case _:
                known = [field.name for field in fields(ExchangeSettings)]
                raise AdaptationError(unknown_key("deeco", name, known))
    return settings


def _interval(name: str, value: object, least: float) -> Duration:
    if _is_number(value) and least <= value <= LONGEST_S:
        return seconds(value)
    raise _wrong(f"deeco.{name}", value, f"a number of seconds from {least} to {LONGEST_S}")


def _area(key: str, table: object) -> Area:
    if not (isinstance(table, dict) and sorted(table) == ["name", "x", "y"]):
        raise _wrong(key, table, "a table with name, x = [from, to] and y = [from, to]")
    if not isinstance(table["name"], str):
        raise _wrong(f"{key}.name", table["name"], "a text")
    (x0, x1), (y0, y1) = _span(f"{key}.x", table["x"]), _span(f"{key}.y", table["y"])
    return Area(table["name"], x0, y0, x1, y1)


def _span(key: str, value: object) -> tuple[float, float]:
    match value:
        case [begin, end] if _is_number(begin) and _is_number(end) and begin < end:
            return float(begin), float(end)
    raise _wrong(key, value, "two numbers [from, to] in m, the first below the second")


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _wrong(key: str, value: object, right: str) -> AdaptationError:
    return AdaptationError(f"{key} is {shown(value)}, but must be {right}")
