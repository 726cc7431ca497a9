"""Where two messages differ first."""

import pytest

from actors.messages import Heard, Received, Sent
from actors.runtime.difference import first_difference

A, B, C = (Heard(instant, 2, -80.0, 100, b"x") for instant in (1, 2, 3))


@pytest.mark.parametrize(
    ("one", "other", "field", "values"),
    [
        ((A, B), (A, C), "Received.events[1].instant", (2, 3)),
        ((A,), (A, B), "Received.events[1]", ("absent", repr(B))),
        ((B,), (A, B), "Received.events[0]", (repr(B), repr(A))),
        ((A, B, C), (A, C), "Received.events[1]", (repr(B), repr(C))),
        ((), (A,), "Received.events[0]", ("absent", repr(A))),
        ((A,), (Sent(1, 2),), "Received.events[0]", (repr(A), repr(Sent(1, 2)))),
    ],
)
def test_what_one_lacks_is_named(
    one: tuple[Heard, ...], other: tuple[Heard | Sent, ...], field: str, values: tuple[object, object]
) -> None:
    found = first_difference(Received(5, one), Received(5, other))
    assert found is not None
    assert (found.field, *map(repr, found[1:])) == (
        field,
        *(v if isinstance(v, str) else repr(v) for v in values),
    )


def test_equal_messages_do_not_differ() -> None:
    assert first_difference(Received(5, (A, B)), Received(5, (A, B))) is None
