"""What is measured: cells, each one kind of course with one localisation, over many seeds."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from actors.runtime.errors import AcrcError
from actors.world.uncertainty import Uncertainty
from benchmarks.localisation.course import CourseSetup
from benchmarks.localisation.filters import Arm, Preset

PRESETS: Final[tuple[Preset, ...]] = ("chapter", "robust")
AFTER: Final = (10.0, 30.0, 60.0)
"""So long after it was put anywhere a robot may have found itself, s."""
COST: Final = "cpu"
"""Names the measurement of one update's cost among the sections."""
CARRIED_AT: Final = 30.0
"""The kidnapped robot is carried then, s."""


class CellError(AcrcError):
    """Cells that do not exist."""


@dataclass(frozen=True)
class CellGoal:
    """What a cell should come to: no robot lost, and this error at most."""

    rmse: float | None
    """m; None: any."""
    lost: float = 0.0
    """Share of the runs."""


@dataclass(frozen=True)
class CourseCell:
    """Courses that differ by their seed only, with one localisation."""

    section: str
    course: CourseSetup
    """Of seed 0, which stands for any."""
    arm: Arm
    runs: int
    """The seeds 1 to this are run."""
    goal: CellGoal | None = None

    @property
    def name(self) -> str:
        """What it is called: section/map/view/odometry/robots/preset, then what else is special."""
        course, arm = self.course, self.arm
        robots = f"{course.robots}{'-at-times' if course.at_times else ''}"
        parts = [self.section, Path(course.plan).stem, view(course), course.base, robots, arm.preset]
        if extra := doses(course):
            parts.append(extra.replace(" ", "-"))
        if self.section == "mask":
            parts.append("on" if arm.masked else "off")
        if arm.recovery is not None:
            parts.append("recovery" if arm.recovery else "no-recovery")
        return "/".join(parts)


def view(course: CourseSetup) -> str:
    """The field of view in degrees, and what else is special."""
    return {"chapter": "360", "written": "360-as-written", "kinect": "58"}[course.view]


def doses(course: CourseSetup) -> str:
    """How the floor differs from the map and odometry drifts; empty: not at all, and no more than usual."""
    told = {field: getattr(course.dose, field) for field in course.dose.__struct_fields__}
    usual = {field: getattr(Uncertainty(), field) for field in told}
    return ", ".join(f"{field} {value:g}" for field, value in told.items() if value != usual[field])


@dataclass(frozen=True)
class Extent:
    """How much is measured."""

    seeds: int = 20
    """Runs per cell."""
    runs: int = 100
    """Runs per cell that has a goal."""
    seconds: float = 240.0
    """Of a course."""
    after: tuple[float, ...] = AFTER
    carried_at: float = CARRIED_AT


def cells(corridor: str, others: Sequence[str], extent: Extent) -> list[CourseCell]:
    """Every cell, on the corridor and, where it matters, on the other maps, which have no symmetry."""
    course = CourseSetup(corridor, 0, seconds=extent.seconds)
    found = [*_goals(course, extent), *_tracking(course, extent)]
    found += [*_range(course, extent), *_mask(course, extent), *_causes(course, extent)]
    for plan in (corridor, *others):
        anywhere = replace(course, plan=plan, base="kobuki")
        found += [*_crowd(anywhere, extent), *_from_nowhere(anywhere, extent)]
    return found


def chosen(everything: Iterable[CourseCell], patterns: Sequence[str]) -> list[CourseCell]:
    """The cells of which the name, or its beginning up to a slash, matches a pattern; all without patterns.

    Raises CellError for a pattern that none matches.
    """
    everything = list(everything)
    for pattern in patterns:
        if not any(_matches(cell, pattern) for cell in everything):
            sections = ", ".join([*dict.fromkeys(cell.section for cell in everything), COST])
            raise CellError(
                f"no cell is called {pattern!r}; right is one of {sections}, or a pattern such as "
                "'tracking/*/360/*/4/robust'"
            )
    return [cell for cell in everything if not patterns or any(_matches(cell, p) for p in patterns)]


def _matches(cell: CourseCell, pattern: str) -> bool:
    return fnmatchcase(cell.name, pattern) or fnmatchcase(cell.name, f"{pattern}/*")


def _goals(course: CourseSetup, extent: Extent) -> Iterator[CourseCell]:
    """The two cells with goals, and the chapter's preset beside the second, which has none."""
    for preset in PRESETS:
        yield CourseCell("alone", course, Arm(preset), extent.runs, CellGoal(0.08))
    among = replace(course, base="kobuki", robots=4, at_times=True)
    yield CourseCell("realistic", among, Arm("robust"), extent.runs, CellGoal(0.15))
    yield CourseCell("realistic", among, Arm("chapter"), extent.runs)


def _tracking(course: CourseSetup, extent: Extent) -> Iterator[CourseCell]:
    for seen in ("chapter", "kinect"):
        for base in ("exact", "kobuki"):
            for robots in (0, 4, 10):
                for preset in PRESETS:
                    setup = replace(course, view=seen, base=base, robots=robots)
                    yield CourseCell("tracking", setup, Arm(preset), extent.seeds)


def _range(course: CourseSetup, extent: Extent) -> Iterator[CourseCell]:
    for seen in ("chapter", "written"):
        for robots in (0, 4, 10):
            for preset in PRESETS:
                setup = replace(course, view=seen, base="kobuki", robots=robots)
                yield CourseCell("range", setup, Arm(preset), extent.seeds)


_DOSES: Final = (
    *(Uncertainty(drift=times) for times in (5.0, 20.0)),
    *(Uncertainty(map_error=error) for error in (0.05, 0.1, 0.2)),
    *(Uncertainty(glass=share) for share in (0.2, 0.5)),
    *(Uncertainty(furniture=things) for things in (10, 30)),
    Uncertainty(0.1, 0.2, 10, 5.0),
)
"""Each alone, and one with a bit of everything."""


def _causes(course: CourseSetup, extent: Extent) -> Iterator[CourseCell]:
    """One cause at a time, from what the chapter's simulation had: nobody near, a full circle, no drift."""
    kobuki = replace(course, base="kobuki")
    setups = [
        course,
        replace(course, base="stage"),
        kobuki,
        replace(course, robots=4, at_times=True),
        *(replace(course, robots=robots) for robots in (4, 10)),
        *(replace(kobuki if dose.drift > 1 else course, dose=dose) for dose in _DOSES),
    ]
    for seen in ("chapter", "kinect"):
        for setup in setups:
            for preset in PRESETS:
                yield CourseCell("causes", replace(setup, view=seen), Arm(preset), extent.seeds)


def _crowd(course: CourseSetup, extent: Extent) -> Iterator[CourseCell]:
    for seen in ("chapter", "kinect"):
        for preset in PRESETS:
            goal = CellGoal(None, 0.05) if preset == "robust" else None
            yield CourseCell("crowd", replace(course, view=seen, robots=10), Arm(preset), extent.seeds, goal)


def _mask(course: CourseSetup, extent: Extent) -> Iterator[CourseCell]:
    for seen in ("chapter", "kinect"):
        for robots, at_times in ((4, True), (2, False), (4, False), (10, False)):
            for preset in PRESETS:
                for masked in (False, True):
                    setup = replace(course, view=seen, base="kobuki", robots=robots, at_times=at_times)
                    yield CourseCell("mask", setup, Arm(preset, masked=masked), extent.seeds)


def _from_nowhere(course: CourseSetup, extent: Extent) -> Iterator[CourseCell]:
    longest = max(extent.after)
    everywhere = replace(course, seconds=longest)
    carried = replace(course, seconds=extent.carried_at + longest, carried_at=extent.carried_at)
    for preset in PRESETS:
        for recovery in (False, True):
            arm = Arm(preset, recovery=recovery)
            yield CourseCell("global", everywhere, replace(arm, placed=False), extent.seeds)
            yield CourseCell("kidnapped", carried, arm, extent.seeds)
