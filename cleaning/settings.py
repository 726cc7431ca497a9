"""A strategy's parameters out of a scenario's table [strategy]."""

import sys
from collections.abc import Mapping
from dataclasses import MISSING, fields
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, TypeVar, get_args, get_origin, get_type_hints

from actors.bounds import ParameterError
from actors.instant import Duration, seconds
from actors.robot.behaviour import Setting
from actors.robot.behaviour.ports import LONGEST_S
from actors.runtime.errors import AcrcError
from actors.wording import shown, unknown_key
from deeco import DeecoError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

P = TypeVar("P", bound="DataclassInstance")
_TABLE: Final = "strategy"
_LARGEST: Final[Mapping[object, float]] = {float: sys.float_info.max, Duration: LONGEST_S}
"""Largest magnitude of a number, by the type of its field; in s for a Duration. No NaN passes it."""
_REFUSALS: Final = (ValueError, AcrcError, DeecoError)


class SettingsError(AcrcError):
    """Settings that a strategy does not have, or that make no sense in it."""


def from_settings(kind: type[P], settings: Mapping[str, Setting]) -> P:
    """The frozen dataclass `kind` with the fields that `settings` names, the others as it has them.

    Fields may be bool, int, float, str, an Enum, which is given by its value, a Duration, which is given in
    seconds, or tuple[X, ...] of one of these; fields of other types cannot be set. A whole number is a float,
    too, but a bool is no number.
    A ValueError, AcrcError or DeecoError of its __post_init__ is passed on with the setting that is to blame.
    Raises SettingsError.
    """
    kinds = _settable(kind)
    values: dict[str, object] = {}
    for name, value in settings.items():
        if name not in kinds:
            raise SettingsError(_unknown(name, kinds))
        values[name] = _converted(name, value, kinds[name])
    required = [one.name for one in fields(kind) if one.default is MISSING is one.default_factory]
    for name in required:
        if name not in values:
            raise SettingsError(f"{_TABLE}.{name} is missing, but must be {_right(kinds.get(name))}")
    return _made(kind, values, settings, required)


def _settable(kind: type[Any]) -> dict[str, Any]:
    """The fields that can be set, with their types."""
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind) if field.init]
    return {name: hints[name] for name in names if _is_settable(hints[name])}


def _is_settable(kind: Any) -> bool:
    if _item(kind) is not None:
        return _is_settable(_item(kind))
    return kind in {bool, int, float, str, Duration} or (isinstance(kind, type) and issubclass(kind, Enum))


def _item(kind: Any) -> Any:
    """What a list of any length holds, by its type; None of another type."""
    arguments = get_args(kind)
    return arguments[0] if get_origin(kind) is tuple and arguments[1:] == (Ellipsis,) else None


def _converted(name: str, value: Setting, kind: Any) -> object:
    """The value as the field wants it."""
    if _item(kind) is not None:
        if isinstance(value, tuple | list):
            return tuple(_converted(name, item, _item(kind)) for item in value)
        raise SettingsError(f"{_TABLE}.{name} is {shown(value)}, but must be {_right(kind)}")
    if isinstance(kind, type) and issubclass(kind, Enum):
        # compared with its type, for True would be 1
        member = next((m for m in kind if type(m.value) is type(value) and m.value == value), None)
        if member is not None:
            return member
    elif kind is float or kind is Duration:
        if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST[kind]:
            return seconds(value) if kind is Duration else float(value)
    elif type(value) is kind:
        return value
    raise SettingsError(f"{_TABLE}.{name} is {shown(value)}, but must be {_right(kind)}")


def _right(kind: Any) -> str:
    """What a field of this type must be."""
    words = {
        bool: "true or false",
        int: "a whole number",
        float: "a finite number",
        str: "a text",
        Duration: f"a number of seconds, at most {LONGEST_S}",
    }
    if kind in words:
        return words[kind]
    if _item(kind) is not None:
        return f"a list, each item {_right(_item(kind))}"
    if isinstance(kind, type) and issubclass(kind, Enum):
        *others, last = [shown(member.value) for member in kind]
        return f"{', '.join(others)} or {last}" if others else last
    return "given by the strategy itself"


def _unknown(name: str, kinds: Mapping[str, Any]) -> str:
    if not kinds:
        return f"{_TABLE}.{name} is not known; this strategy has no settings"
    return unknown_key(_TABLE, name, kinds)


def _made(
    kind: type[P], values: Mapping[str, Any], settings: Mapping[str, Setting], required: list[str]
) -> P:
    """The parameters; what they refuse is said with the setting that is wrong alone, or with all of them."""
    try:
        return kind(**values)
    except ParameterError as error:
        name = error.key.rpartition(".")[2]
        if name in settings:  # as it stands in the file, where durations are in s
            sentence = f"{_TABLE}.{name} is {shown(settings[name])}, but must be {error.right}"
            raise SettingsError(sentence) from error
        refusal: Exception = error
    except _REFUSALS as error:
        refusal = error
    least = {name: values[name] for name in required}
    for name, value in values.items():
        try:
            kind(**least | {name: value})
        except _REFUSALS as error:
            raise SettingsError(f"{_TABLE}.{name} is {shown(settings[name])}: {error}") from error
    all_of_them = ", ".join(f"{_TABLE}.{name} is {shown(value)}" for name, value in settings.items())
    raise SettingsError(f"{all_of_them}: {refusal}") from refusal
