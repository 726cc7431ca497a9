"""What is wrong with a number among parameters, in a sentence."""

import math
from collections.abc import Iterable, Mapping

from actors.robot.navigation.cell_distance import MOST_REACH
from actors.runtime.errors import AcrcError


class ParameterError(AcrcError):
    """A number among parameters that makes no sense."""


def check(
    table: str,
    parameters: object,
    *,
    positive: Iterable[str] = (),
    least: Mapping[str, float] | None = None,
    most: Mapping[str, float] | None = None,
) -> None:
    """Raise ParameterError for a field in `positive` that is not above 0, or one beyond `least` or `most`.

    `table`: how the sentence names the parameters.
    """
    for name in positive:
        value = getattr(parameters, name)
        if not 0 < value < math.inf:
            raise ParameterError(f"{table}.{name} is {value:g}, but must be above 0")
    for name, bound in (least or {}).items():
        value = getattr(parameters, name)
        if not bound <= value < math.inf:
            raise ParameterError(f"{table}.{name} is {value:g}, but must be at least {bound:g}")
    for name, bound in (most or {}).items():
        value = getattr(parameters, name)
        if value > bound:
            raise ParameterError(f"{table}.{name} is {value:g}, but must be at most {bound:g}")


def check_reach(what: str, reach: float, cell: float) -> None:
    """Raise ParameterError if `reach`, m, is more cells of side `cell`, m, than distances are known for."""
    if reach > MOST_REACH * cell:
        raise ParameterError(
            f"{what} reaches {reach:g} m far, but must reach at most {MOST_REACH} cells of {cell:g} m"
        )
