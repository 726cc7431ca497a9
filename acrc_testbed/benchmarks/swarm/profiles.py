"""Profiles of a run by package, and counts of allocated memory blocks."""

import cProfile
import ctypes
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import CodeType
from typing import Any, Final, Literal

import numpy as np
from numba import carray, cfunc, types

from actors.installation.repository import PACKAGES, REPOSITORY

Function = tuple[str, int, str]
"""File, line and name, as in `pstats`; a built-in function has the file `~`."""
Entry = tuple[float, Mapping[Function, float]]
"""Calls, or seconds, of a function: all, and by caller."""
_ROUNDS: Final = 50
"""Longest chain of calls within packages that is attributed to a caller of this project."""
NO_ROOM: Final = "elsewhere"
_ADDRESS: Final = re.compile(r" at 0x[0-9a-f]+")
_OBJECTS: Final = 2
"""PYMEM_DOMAIN_OBJ of CPython: objects and their contents."""


def entries(
    profile: cProfile.Profile, weight: Literal["callcount", "inlinetime"] = "callcount"
) -> dict[Function, Entry]:
    """Return calls, or seconds without callees, of every function; sum functions of one label.

    `pstats` keeps only the last of the functions with one label, such as `__new__` of named tuples.
    """
    whole: Counter[Function] = Counter()
    callers: defaultdict[Function, Counter[Function]] = defaultdict(Counter)
    for entry in profile.getstats():
        caller = _label(entry.code)
        whole[caller] += getattr(entry, weight)
        for callee in entry.calls or ():
            callers[_label(callee.code)][caller] += getattr(callee, weight)
    return {function: (value, callers[function]) for function, value in whole.items()}


def _label(code: CodeType | str) -> Function:
    return ("~", 0, code) if isinstance(code, str) else (code.co_filename, code.co_firstlineno, code.co_name)


def by_room(called: Mapping[Function, Entry]) -> dict[str, float]:
    """Sum `called` by package folder.

    Functions outside this project count for their callers, in proportion; the sum of all is kept.
    """
    rooms: defaultdict[str, float] = defaultdict(float)
    open_calls: dict[Function, float] = {}
    for function, (calls, _) in called.items():
        room = room_of(function)
        if room is None:
            open_calls[function] = calls
        else:
            rooms[room] += calls
    for _ in range(_ROUNDS):
        if not open_calls:
            break
        open_calls = _passed_up(open_calls, called, rooms)
    rooms[NO_ROOM] += sum(open_calls.values())
    return rooms


def _passed_up(
    open_calls: Mapping[Function, float], called: Mapping[Function, Entry], rooms: defaultdict[str, float]
) -> dict[Function, float]:
    """Attribute values to the folders of callers; return those whose callers are outside this project."""
    left: dict[Function, float] = {}
    for function, calls in open_calls.items():
        callers = called[function][1]
        whole = sum(callers.values())
        if not whole:
            rooms[NO_ROOM] += calls
        for caller, times in callers.items():
            share, room = calls * times / whole, room_of(caller)
            if room is None:
                left[caller] = left.get(caller, 0.0) + share
            else:
                rooms[room] += share
    return left


def room_of(function: Function) -> str | None:
    """Return the package folder of a function of this project, with `/`; None for any other function."""
    path = Path(function[0])
    if not path.is_relative_to(REPOSITORY):
        return None
    inside = path.relative_to(REPOSITORY)
    return inside.parent.as_posix() if inside.parts[0] in PACKAGES else None


def name_of(function: Function) -> str:
    """Return file and name of a function for display."""
    file, _, name = function
    if file == "~":
        return _ADDRESS.sub("", name.strip("<>"))
    path = Path(file)
    if path.is_relative_to(REPOSITORY) and room_of(function):
        return f"{path.relative_to(REPOSITORY).as_posix()}: {name}"
    return f"{path.name}: {name}"


class _Allocator(ctypes.Structure):
    """PyMemAllocatorEx of CPython."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("context", "malloc", "calloc", "realloc", "free")]


class BlockCount:
    """Number of memory blocks requested from Python's allocator."""

    def __init__(self) -> None:
        self.array = np.zeros(1, np.int64)

    @property
    def blocks(self) -> int:
        """Return the count so far."""
        return int(self.array[0])


@contextmanager
def counted_blocks() -> Iterator[BlockCount]:
    """Count blocks allocated for objects, freed ones included.

    Small tuples, floats and the like from CPython's free lists are not allocated and not counted.
    """
    count, before = BlockCount(), _Allocator()
    ctypes.pythonapi.PyMem_GetAllocator(_OBJECTS, ctypes.byref(before))
    malloc = _counting(ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)(before.malloc))
    assert not before.context, "the context would not reach the original allocator"
    address = int(count.array.ctypes.data)
    counting = _Allocator(address, malloc.address, before.calloc, before.realloc, before.free)
    ctypes.pythonapi.PyMem_SetAllocator(_OBJECTS, ctypes.byref(counting))
    try:
        yield count
    finally:
        ctypes.pythonapi.PyMem_SetAllocator(_OBJECTS, ctypes.byref(before))


def _counting(plain: Any) -> Any:
    """Compile a malloc that increments the count at its context's address, then calls `plain`."""

    @cfunc(types.voidptr(types.voidptr, types.uintp))  # type: ignore[untyped-decorator]
    def malloc(context: Any, size: int) -> Any:
        carray(context, 1, np.int64)[0] += 1
        return plain(context, size)

    return malloc
