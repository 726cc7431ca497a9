"""Calls of a profile by room; those of the standard library and of packages count for their caller's."""

import cProfile
import re
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from types import CodeType
from typing import Final

from actors.installation.repository import PACKAGES, REPOSITORY

Function = tuple[str, int, str]
"""File, line and name, as `pstats` tells functions apart; a built-in function's file is `~`."""
_Entry = tuple[int, Mapping[Function, int]]
"""How often it was called, and how often by whom."""
_ROUNDS: Final = 50
"""So deep do packages call one another, at most; what is left then is nobody's."""
NOBODY: Final = "elsewhere"
_ADDRESS: Final = re.compile(r" at 0x[0-9a-f]+")
"""Of the type whose `__new__` it is; another one in each process."""


def entries(profile: cProfile.Profile) -> dict[Function, _Entry]:
    """Every function that was called, with those of one name in one line, as makers of named tuples, summed.

    `pstats` keeps the last of such functions alone.
    """
    calls: Counter[Function] = Counter()
    callers: defaultdict[Function, Counter[Function]] = defaultdict(Counter)
    for entry in profile.getstats():
        caller = _label(entry.code)
        calls[caller] += entry.callcount
        for callee in entry.calls or ():
            callers[_label(callee.code)][caller] += callee.callcount
    return {function: (times, callers[function]) for function, times in calls.items()}


def _label(code: CodeType | str) -> Function:
    return ("~", 0, code) if isinstance(code, str) else (code.co_filename, code.co_firstlineno, code.co_name)


def by_room(called: Mapping[Function, _Entry]) -> dict[str, float]:
    """Calls by the folder of the package that makes them.

    A function of no room of ours counts for its callers, in proportion to how often each calls it, and so on
    up: the sum over all rooms is the number of all calls.
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
    rooms[NOBODY] += sum(open_calls.values())
    return rooms


def _passed_up(
    open_calls: Mapping[Function, float], called: Mapping[Function, _Entry], rooms: defaultdict[str, float]
) -> dict[Function, float]:
    """Hand calls to the rooms that made them; what is left are those of callers of no room."""
    left: dict[Function, float] = {}
    for function, calls in open_calls.items():
        callers = called[function][1]
        whole = sum(callers.values())
        if not whole:
            rooms[NOBODY] += calls
        for caller, times in callers.items():
            share, room = calls * times / whole, room_of(caller)
            if room is None:
                left[caller] = left.get(caller, 0.0) + share
            else:
                rooms[room] += share
    return left


def room_of(function: Function) -> str | None:
    """The folder, `/` between its names, of a function of this project; None for any other."""
    path = Path(function[0])
    if not path.is_relative_to(REPOSITORY):
        return None
    inside = path.relative_to(REPOSITORY)
    return inside.parent.as_posix() if inside.parts[0] in PACKAGES else None


def name_of(function: Function) -> str:
    """The function for people: its file within the project, or as its package has it, and its name."""
    file, _, name = function
    if file == "~":
        return _ADDRESS.sub("", name.strip("<>"))
    path = Path(file)
    if path.is_relative_to(REPOSITORY) and room_of(function):
        return f"{path.relative_to(REPOSITORY).as_posix()}: {name}"
    return f"{path.name}: {name}"
