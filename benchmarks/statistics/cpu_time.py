"""CPU time of one piece of work."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def best(prepare: Callable[[], T], work: Callable[[T], object], repeats: int) -> float:
    """CPU seconds of the fastest of several repeats of `work`, after one that does not count.

    Each gets a new result of `prepare`, whose own time is left out.
    """
    work(prepare())
    times = []
    for _ in range(repeats):
        thing = prepare()
        begun = time.process_time()
        work(thing)
        times.append(time.process_time() - begun)
    return min(times)
