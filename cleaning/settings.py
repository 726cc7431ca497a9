"""A strategy's parameters out of a scenario's table [strategy]."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Final, TypeVar

from actors.robot.behaviour import Setting
from actors.runtime.errors import AcrcError
from actors.settings import ParameterError, decode, fields_of
from actors.wording import shown
from deeco import DeecoError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

P = TypeVar("P", bound="DataclassInstance")
_TABLE: Final = "strategy"
_REFUSALS: Final = (ValueError, AcrcError, DeecoError)


class SettingsError(AcrcError):
    """Settings that a strategy does not have, or that make no sense in it."""


def from_settings(kind: type[P], settings: Mapping[str, Setting]) -> P:
    """Return the frozen dataclass `kind` with the fields that `settings` names, the others with defaults.

    Fields may be bool, int, float, str, an Enum, which is given by its value, a Duration, which is given in
    seconds, or tuple[X, ...] of one of these; fields of other types cannot be set. A whole number is a float,
    too, but a bool is no number. Bounds are those of `msgspec.Meta` in the types, and of __post_init__: its
    ValueError, AcrcError or DeecoError is passed on with the setting that causes it. Raises SettingsError.
    """
    try:
        return decode(kind, settings, _TABLE)
    except ParameterError as error:
        if error.key.startswith(f"{_TABLE}.") and not fields_of(kind):
            raise SettingsError(f"{error.key} is not known; this strategy has no settings") from None
        raise SettingsError(str(error)) from error
    except _REFUSALS as error:
        raise SettingsError(_refused(kind, settings, error)) from error


def _refused(kind: type[P], settings: Mapping[str, Setting], refusal: Exception) -> str:
    """Return why `kind` refuses the settings: with the one that it refuses alone, or with all of them."""
    required = [one.name for one in fields(kind) if one.default is MISSING is one.default_factory]
    least = {name: settings[name] for name in required}
    for name, value in settings.items():
        try:
            decode(kind, least | {name: value}, _TABLE)
        except _REFUSALS as error:
            return f"{_TABLE}.{name} is {shown(value)}: {error}"
    return f"{', '.join(f'{_TABLE}.{name} is {shown(value)}' for name, value in settings.items())}: {refusal}"
