"""What is wrong with a number among parameters, in a sentence."""

import math
from collections.abc import Iterable, Mapping

from actors.runtime.errors import AcrcError


class ParameterError(AcrcError):
    """A number among parameters that makes no sense."""


def check(
    table: str, parameters: object, *, positive: Iterable[str] = (), least: Mapping[str, float] | None = None
) -> None:
    """Raise ParameterError if a field in `positive` is not above 0, or one in `least` below what that says.

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
