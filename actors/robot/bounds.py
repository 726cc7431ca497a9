"""What is wrong with a value among parameters, in a sentence."""

import math
from collections.abc import Iterable, Mapping, Sequence

from actors.runtime.errors import AcrcError


class ParameterError(AcrcError):
    """A value among parameters that makes no sense."""


def check(
    table: str,
    parameters: object,
    *,
    positive: Iterable[str] = (),
    least: Mapping[str, float] | None = None,
    most: Mapping[str, float] | None = None,
    known: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Raise ParameterError for a field in `positive` that is not above 0, one beyond `least` or `most`, or
    one that is none of its names in `known`.

    `table`: how the sentence names the parameters.
    """
    for name, names in (known or {}).items():
        if getattr(parameters, name) not in names:
            raise ParameterError(
                f"{table}.{name} is {getattr(parameters, name)!r}, but must be one of {', '.join(names)}"
            )
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
