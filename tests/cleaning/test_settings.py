"""A strategy's parameters out of a scenario's settings, and every way in which they do not fit."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from actors.instant import Duration, milliseconds, seconds
from actors.robot.behaviour import Setting
from actors.runtime.errors import AcrcError
from cleaning.settings import SettingsError, from_settings


class Mode(Enum):
    BOLD = "bold"
    SHY = "shy"
    SILENT = 1


@dataclass(frozen=True)
class Parameters:
    reach: float = 0.5
    tries: int = 3
    fair: bool = False
    title: str = "none"
    mode: Mode = Mode.SHY
    lease: Duration = field(default=seconds(2))
    points: tuple[float, ...] = ()
    fixed: int = field(default=7, init=False)

    def __post_init__(self) -> None:
        if self.lease < 0:
            raise ValueError("a lease should be at least 0 s")
        if self.fair and self.mode is Mode.BOLD:
            raise AcrcError("who is fair should not be bold")


@dataclass(frozen=True)
class Needy:
    deadline: Duration
    share: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.share <= 1:
            raise ValueError("it should be above 0 and at most 1")


@dataclass(frozen=True)
class Fixed:
    points: tuple[tuple[float, float], ...] = ()


def refusal(kind: type[Parameters | Needy | Fixed], settings: Mapping[str, Setting]) -> str:
    with pytest.raises(SettingsError) as caught:
        from_settings(kind, settings)
    return str(caught.value)


def test_each_kind_of_field_is_set() -> None:
    given_ones: dict[str, Setting] = {
        "reach": 1, "tries": 4, "fair": True, "title": "x", "mode": "shy", "lease": 0.25
    }  # fmt: skip
    made = from_settings(Parameters, given_ones)
    assert made == Parameters(1.0, 4, True, "x", Mode.SHY, milliseconds(250))
    assert type(made.reach) is float
    assert from_settings(Parameters, {"mode": 1}).mode is Mode.SILENT
    assert from_settings(Parameters, {"lease": 3}).lease == seconds(3)


def test_what_is_absent_stays() -> None:
    assert from_settings(Parameters, {}) == Parameters()
    assert from_settings(Needy, {"deadline": 1}) == Needy(seconds(1))


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"leese": 1}, "strategy.leese is not known; did you mean strategy.lease?"),
        (
            {"xyz": 1},
            "strategy.xyz is not known; strategy may hold reach, tries, fair, title, mode, lease, points",
        ),
        ({"points": "1, 2"}, 'strategy.points is "1, 2", but must be a list, each item a finite number'),
        ({"points": (1, "2")}, 'strategy.points is "2", but must be a finite number'),
        ({"reach": "far"}, 'strategy.reach is "far", but must be a finite number'),
        ({"reach": True}, "strategy.reach is true, but must be a finite number"),
        ({"reach": math.nan}, "strategy.reach is NaN, but must be a finite number"),
        ({"tries": 2.0}, "strategy.tries is 2.0, but must be a whole number"),
        ({"fair": 1}, "strategy.fair is 1, but must be true or false"),
        ({"title": 1}, "strategy.title is 1, but must be a text"),
        ({"mode": "brave"}, 'strategy.mode is "brave", but must be "bold", "shy" or 1'),
        ({"lease": "2 s"}, 'strategy.lease is "2 s", but must be a number of seconds, at most 1000000'),
        ({"lease": 1e7}, "strategy.lease is 10000000.0, but must be a number of seconds, at most 1000000"),
        ({"reach": 2, "lease": -1}, "strategy.lease is -1: a lease should be at least 0 s"),
        (
            {"fair": True, "mode": "bold"},
            'strategy.fair is true, strategy.mode is "bold": who is fair should not be bold',
        ),
    ],
)
def test_what_does_not_fit_is_one_sentence(settings: Mapping[str, Setting], sentence: str) -> None:
    assert refusal(Parameters, settings) == sentence


def test_what_has_no_default_must_be_there() -> None:
    assert (
        refusal(Needy, {}) == "strategy.deadline is missing, but must be a number of seconds, at most 1000000"
    )
    assert refusal(Needy, {"share": 2.0, "deadline": 1}) == (
        "strategy.share is 2.0: it should be above 0 and at most 1"
    )

    assert refusal(Parameters, {"reach": 10**400}).endswith("…, but must be a finite number")
    assert refusal(Fixed, {"lease": 1}) == "strategy.lease is not known; this strategy has no settings"


@given(some.dictionaries(some.sampled_from(["reach", "tries", "mode", "lease", "odd"]), some.one_of(
    some.booleans(), some.integers(), some.floats(), some.text(max_size=5)
)))  # fmt: skip
@settings(deadline=None, derandomize=True)
def test_it_is_parameters_or_one_sentence(wanted: Mapping[str, Setting]) -> None:
    try:
        made = from_settings(Parameters, wanted)
    except SettingsError as error:
        assert str(error).startswith("strategy.") and "\n" not in str(error)
    else:
        assert isinstance(made.reach, float) and math.isfinite(made.reach)
        assert type(made.tries) is type(made.lease) is int
