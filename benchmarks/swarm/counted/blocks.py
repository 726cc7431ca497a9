"""Memory blocks that Python asks its allocator for, counted one by one."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
from numba import carray, cfunc, types

_OBJECTS: Final = 2
"""PYMEM_DOMAIN_OBJ of CPython: where objects live, and what they hold beside themselves."""


class _Allocator(ctypes.Structure):
    """PyMemAllocatorEx of CPython."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("context", "malloc", "calloc", "realloc", "free")]


class BlockCount:
    """How many blocks have been asked for."""

    def __init__(self) -> None:
        self._count = np.zeros(1, np.int64)

    @property
    def blocks(self) -> int:
        """So far."""
        return int(self._count[0])

    @property
    def address(self) -> int:
        """Where compiled code counts."""
        return int(self._count.ctypes.data)


@contextmanager
def counted_blocks() -> Iterator[BlockCount]:
    """Count the blocks of objects that are allocated meanwhile, freed ones included.

    What CPython takes from its lists of free objects, such as small tuples and floats, is no block.
    """
    count, before = BlockCount(), _Allocator()
    ctypes.pythonapi.PyMem_GetAllocator(_OBJECTS, ctypes.byref(before))
    malloc = _counting(ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)(before.malloc))
    assert not before.context, "the context would not reach the allocator behind"
    counting = _Allocator(count.address, malloc.address, before.calloc, before.realloc, before.free)
    ctypes.pythonapi.PyMem_SetAllocator(_OBJECTS, ctypes.byref(counting))
    try:
        yield count
    finally:
        ctypes.pythonapi.PyMem_SetAllocator(_OBJECTS, ctypes.byref(before))


def _counting(plain: Any) -> Any:
    """`plain`, which minds no context, behind a count that lies at the context's address; native code."""

    @cfunc(types.voidptr(types.voidptr, types.uintp))  # type: ignore[untyped-decorator]
    def malloc(context: Any, size: int) -> Any:
        carray(context, 1, np.int64)[0] += 1
        return plain(context, size)

    return malloc
