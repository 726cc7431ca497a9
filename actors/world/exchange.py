"""All bodies of a pymunk space at once: forces into it, states and contacts out of it, a call for each.

The functions of pymunk's own module `batch` do it; what they lay out at each call is kept here, so that a
sub-step takes fewer Python calls. This needs what pymunk keeps to itself (`_chipmunk`, `_space`,
`_float_arr`), as it is in 7.3; `pyproject.toml` asks for that.
"""

from typing import Any, Final

import numpy as np
import pymunk
from numpy.typing import NDArray
from pymunk import batch
from pymunk._chipmunk import ffi, lib

_STATE: Final = (
    batch.BodyFields.POSITION
    | batch.BodyFields.ANGLE
    | batch.BodyFields.VELOCITY
    | batch.BodyFields.ANGULAR_VELOCITY
)
_FORCES: Final = batch.BodyFields.FORCE | batch.BodyFields.TORQUE
_CONTACTS: Final = (
    batch.ArbiterFields.BODY_A_ID
    | batch.ArbiterFields.BODY_B_ID
    | batch.ArbiterFields.IS_FIRST_CONTACT
    | batch.ArbiterFields.NORMAL
)
_GET: Final = ffi.addressof(lib, "pmSpaceBodyGetIteratorFuncBatched")
_SET: Final = ffi.addressof(lib, "pmSpaceBodySetIteratorFuncBatched")
_MEET: Final = ffi.addressof(lib, "pmSpaceArbiterIteratorFuncBatched")


class BodyExchange:
    """With one space, whose bodies, in the order in which they came, stay the same."""

    def __init__(self, space: pymunk.Space, forces: NDArray[np.float64]) -> None:
        """`forces`: (n + 1, 3), N, N, N m, kept and read at each `step`; the last row is for what does not
        move, which is a body to pymunk too."""
        self._space = space
        self._address = space._space
        self._into, self._out_of, self._met = batch.Buffer(), batch.Buffer(), batch.Buffer()
        self._into.set_float_buf(forces.reshape(-1))
        self._pushed = _request(_FORCES, self._into)
        self._looked = _request(_STATE, self._out_of)
        self._asked = _request(_CONTACTS, self._met)
        self._floats, self._states = self._into._float_arr, self._out_of._float_arr
        self._numbers, self._normals = self._met._int_arr, self._met._float_arr
        lib.cpSpaceEachBody(self._address, _GET, self._looked)
        self.states: NDArray[np.float64] = np.frombuffer(self._out_of.float_buf()).reshape(-1, 6)
        """(n + 1, 6): x, y, heading, vx, vy, omega after the last `step`, which writes to the same memory."""

    def step(self, dt: float, *, whole: bool) -> None:
        """Let the forces act on the bodies for so long, s, and take the states over.

        `whole`: with all that pymunk does around it for what was added or removed since the last such step;
        else the physics alone, which is the same where nothing was.
        """
        self._floats.num = 0  # where reading begins
        lib.cpSpaceEachBody(self._address, _SET, self._pushed)
        if whole:
            self._space.step(dt)
        else:
            lib.cpSpaceStep(self._address, dt)
        self._states.num = 0  # where writing begins
        lib.cpSpaceEachBody(self._address, _GET, self._looked)

    def contacts(self) -> tuple[NDArray[np.uint64], NDArray[np.float64]] | None:
        """Those of the last sub-step, None without any: (m, 3), numbers of both bodies, and whether it is
        new; (m, 2), the normal from the first to the second. Good until the next call."""
        self._numbers.num = self._normals.num = 0
        lib.cpSpaceEachCachedArbiter(self._address, _MEET, self._asked)
        if not self._numbers.num:
            return None
        pairs = np.frombuffer(self._met.int_buf(), np.uint64).reshape(-1, 3)
        return pairs, np.frombuffer(self._met.float_buf()).reshape(-1, 2)


def _request(fields: batch.BodyFields | batch.ArbiterFields, buffer: batch.Buffer) -> Any:
    """What the functions of C want to be told."""
    data = ffi.new("pmBatchedData *")
    data.fields, data.floatArray, data.intArray = fields.value, buffer._float_arr, buffer._int_arr
    return data
