"""Maps and courses that the tests share."""

from functools import lru_cache
from pathlib import Path

from benchmarks.localisation.course import Course, CourseSetup, made

MAPS = Path(__file__).parents[2] / "maps"
CORRIDOR, APARTMENT = str(MAPS / "corridor.yaml"), str(MAPS / "apartment.yaml")


@lru_cache
def course(setup: CourseSetup) -> Course:
    """That course, driven once."""
    return made(setup)
