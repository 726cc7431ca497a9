"""How pymunk's polygons are turned: by our own sine and cosine, since its own are those of the C library.

Discs need none of this: a disc's place does not depend on its angle.
"""

from typing import Any, Final

import pymunk
from pymunk._chipmunk import ffi

from actors.portable import cos_sin

_ANGLE: Final = 14
"""Where a cpBody (Chipmunk 7, chipmunk_structs.h) holds its angle, in doubles from its begin …"""
_TURN: Final = 17
"""… and its transform: cosine, sine, minus sine, cosine, x, y."""


def turn_by_ourselves(body: pymunk.Body) -> None:
    """From now on give the body's shapes, whenever it has moved, the rotation that belongs to its angle."""
    _check_layout()
    body.position_func = _move
    turn(body)


def turn(body: pymunk.Body) -> None:
    """Give a body whose angle was set the rotation that belongs to it."""
    doubles = _doubles(body)
    c, s = cos_sin(doubles[_ANGLE])
    doubles[_TURN], doubles[_TURN + 1], doubles[_TURN + 2], doubles[_TURN + 3] = c, s, -s, c


def _move(body: pymunk.Body, dt: float) -> None:
    pymunk.Body.update_position(body, dt)
    turn(body)


def _doubles(body: pymunk.Body) -> Any:
    return ffi.cast("double *", body._body)


def _check_layout() -> None:
    """That a body looks as another release of pymunk might not have it."""
    body = pymunk.Body(2.0, 3.0)
    body.position, body.angle = (7.0, 9.0), 0.5
    found = _doubles(body)
    c, s = cos_sin(0.5)
    expected = (c, s, -s, c, 7.0, 9.0)
    places = zip(range(_TURN, _TURN + 6), expected, strict=True)
    assert found[_ANGLE] == 0.5
    assert all(abs(found[place] - value) < 1e-12 for place, value in places)
