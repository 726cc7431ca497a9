"""What parameters in code refuse, in a sentence of one form."""

import math
from dataclasses import dataclass

import pytest

from actors.bounds import ParameterError, check, check_range
from actors.runtime.errors import AcrcError


@dataclass(frozen=True)
class Parameters:
    length: float = 1.0
    count: int = 1
    share: float = 0.5
    mode: str = "bold"

    def __post_init__(self) -> None:
        check(
            "table",
            self,
            positive=("length",),
            least={"count": 1},
            most={"count": 2**40},
            ranges={"share": (0, 1)},
            known={"mode": ("bold", "shy")},
        )


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"length": 0.0}, "table.length is 0, but must be above 0"),
        ({"length": math.inf}, "table.length is inf, but must be above 0"),
        ({"length": math.nan}, "table.length is nan, but must be above 0"),
        ({"count": 0}, "table.count is 0, but must be at least 1"),
        ({"count": 2**40 + 1}, "table.count is 1099511627777, but must be at most 1099511627776"),
        ({"count": math.nan}, "table.count is nan, but must be at most 1099511627776"),
        ({"share": 1.5}, "table.share is 1.5, but must be from 0 to 1"),
        ({"share": math.nan}, "table.share is nan, but must be from 0 to 1"),
        ({"mode": "brave"}, 'table.mode is "brave", but must be "bold" or "shy"'),
    ],
)
def test_a_value_out_of_bounds(values: dict[str, float], sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        Parameters(**values)  # type: ignore[arg-type]
    assert str(caught.value) == sentence
    assert isinstance(caught.value, ValueError) and isinstance(caught.value, AcrcError)


def test_the_ends_are_within() -> None:
    assert Parameters(1e-300, 1, 0.0, "shy") and Parameters(1.0, 2**40, 1.0)
    check_range("port", 65535, 1, 65535)
