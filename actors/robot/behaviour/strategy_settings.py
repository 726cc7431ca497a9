"""Conversion of a scenario's table [strategy] into a strategy's parameters."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Final, TypeVar

from actors.robot.behaviour.ports import Setting
from actors.runtime.errors import AcrcError
from actors.settings import ParameterError, decode, fields_of
from actors.wording import toml_text
from deeco import DeecoError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

P = TypeVar("P", bound="DataclassInstance")
_TABLE: Final = "strategy"
_REFUSALS: Final = (ValueError, AcrcError, DeecoError)


class SettingsError(AcrcError):
    """Unknown or invalid settings of a strategy."""


def from_settings(kind: type[P], settings: Mapping[str, Setting]) -> P:
    """Return the frozen dataclass `kind` with fields from `settings` and defaults for the others.

    Supported types: bool, int, float, str, Enum (given by value), Duration (given in s) and tuple[X, ...] of
    these. A whole number is accepted as float; a bool is not a number. Bounds come from `msgspec.Meta` and
    from __post_init__, whose ValueError, AcrcError or DeecoError is reported with the setting that causes it.
    Raises SettingsError.
    """
    try:
        return decode(kind, settings, _TABLE)
    except ParameterError as error:
        if error.key.startswith(f"{_TABLE}.") and not fields_of(kind):
            raise SettingsError(f"unknown key {error.key}; this strategy has no settings") from None
        raise SettingsError(str(error)) from error
    except _REFUSALS as error:
        raise SettingsError(_refused(kind, settings, error)) from error


def _refused(kind: type[P], settings: Mapping[str, Setting], refusal: Exception) -> str:
    """Return the error of `kind` with the setting that causes it, or with all settings."""
    required = [one.name for one in fields(kind) if one.default is MISSING is one.default_factory]
    least = {name: settings[name] for name in required}
    for name, value in settings.items():
        try:
            decode(kind, least | {name: value}, _TABLE)
        except _REFUSALS as error:
            return f"{_TABLE}.{name} is {toml_text(value)}: {error}"
    return f"{', '.join(f'{_TABLE}.{key} is {toml_text(one)}' for key, one in settings.items())}: {refusal}"
