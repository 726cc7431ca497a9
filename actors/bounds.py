"""Bounds of parameters that stand in code: what a `__post_init__` refuses, in a sentence of one form."""

import math
from collections.abc import Iterable, Mapping, Sequence

from actors import wording
from actors.runtime.errors import AcrcError


class ParameterError(AcrcError, ValueError):
    """A value among parameters that makes no sense."""

    def __init__(self, key: str, value: object, right: str) -> None:
        """`right`: what it must be, in words that go on after "must be"."""
        super().__init__(f"{key} is {_shown(value)}, but must be {right}")
        self.key = key
        self.right = right


def check(
    table: str,
    parameters: object,
    *,
    positive: Iterable[str] = (),
    least: Mapping[str, float] | None = None,
    most: Mapping[str, float] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    known: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Raise ParameterError for a field in `positive` that is not above 0, one beyond `least`, `most` or its
    range, ends included, or one that is none of its names in `known`; what has no upper bound must be finite.

    `table`: how the sentence names the parameters.
    """
    for name, names in (known or {}).items():
        if getattr(parameters, name) not in names:
            raise ParameterError(f"{table}.{name}", getattr(parameters, name), wording.one_of(names))
    for name, bound in (most or {}).items():
        value = getattr(parameters, name)
        if not value <= bound:
            raise ParameterError(f"{table}.{name}", value, wording.span(le=bound))
    for name in positive:
        value = getattr(parameters, name)
        if not 0 < value < math.inf:
            raise ParameterError(f"{table}.{name}", value, wording.span(gt=0))
    for name, bound in (least or {}).items():
        value = getattr(parameters, name)
        if not bound <= value < math.inf:
            raise ParameterError(f"{table}.{name}", value, wording.span(ge=bound))
    for name, (low, high) in (ranges or {}).items():
        check_range(f"{table}.{name}", getattr(parameters, name), low, high)


def check_unused(table: str, parameters: object, names: Iterable[str], where: str) -> None:
    """Raise ParameterError for a field that is not as it is without a word, though nothing uses it.

    `where`: in which case nothing does, in words that go on after "where".
    """
    for name in names:
        value = getattr(parameters, name)
        if value != getattr(type(parameters), name):
            raise ParameterError(f"{table}.{name}", value, f"left out where {where}, which does not use it")


def check_range(key: str, value: float, least: float, most: float) -> None:
    """Raise ParameterError for a value that is not from `least` to `most`, ends included."""
    if not least <= value <= most:
        raise ParameterError(key, value, wording.span(ge=least, le=most))


def _shown(value: object) -> str:
    return wording.number(value) if isinstance(value, int | float) else wording.shown(value)
