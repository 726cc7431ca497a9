"""Warnings about scenarios before a run; some compared with runs in memory."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from actors.installation.repository import SHIPPED
from deploy.scenario.map_survey import json_content, sentences
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario, parse
from deploy.scenario.survey import scenario_warnings, survey
from deploy.scenario.tables import Scenario
from tests.recorded_runs import record

Poses = Sequence[tuple[float, float, float]]
Points = Sequence[Sequence[tuple[float, float]]]


def rooms(folder: Path, cell: float = 0.05, door: float | None = None, thick: float = 0.2) -> None:
    """Draw a room of 6 m by 4 m, with an optional wall at x = 3 m with a door at y = 1.5 m."""
    walls = np.ones((round(4 / cell) + 2, round(6 / cell) + 2), np.bool_)
    walls[1:-1, 1:-1] = False
    if door is not None:
        west, begin = round(3 / cell) + 1, round(1.5 / cell) + 1
        east = west + max(1, round(thick / cell))
        walls[:, west:east] = True
        walls[begin : begin + round(door / cell), west:east] = False
    Image.fromarray(np.where(walls, 0, 255).astype(np.uint8)[::-1]).save(folder / "m.pgm")
    (folder / "m.yaml").write_text(
        f"image: m.pgm\nresolution: {cell}\norigin: [{-cell}, {-cell}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def scenario(
    folder: Path, starts: Poses, places: Points, more: str = "", preset: str = "", strategy: str = "none"
) -> Scenario:
    text = f'map = "m.yaml"\nrun = {{ duration = 40.0, strategy = "{strategy}" }}\n'
    text += f"robots = {{ count = {len(starts)} }}\n"
    text += f'navigation = {{ preset = "{preset}" }}\n' if preset else ""
    text += "".join(
        f'[[robot]]\nid = "r{number}"\nstart = {list(start)}\nplaces = {[list(point) for point in own]}\n'
        for number, (start, own) in enumerate(zip(starts, places, strict=True), start=1)
    )
    return parse(text + more, folder / "s.toml")


def warned(settled: Scenario) -> tuple[str, ...]:
    return scenario_warnings(resolve(settled))


@pytest.mark.parametrize(
    ("preset", "cell", "start", "needed"),
    [
        ("chapter", 0.05, (0.2, 2.0, 0.0), "0.21"),
        ("chapter", 0.1, (0.24, 2.0, -2.2), "0.25"),
        ("chapter", 0.1, (0.25, 2.0, -2.2), None),
    ],
)
def test_a_start_that_the_local_planner_cannot_leave(
    preset: str, cell: float, start: tuple[float, float, float], needed: str | None, tmp_path: Path
) -> None:
    rooms(tmp_path, cell)
    settled = scenario(tmp_path, [start], [[(5.0, 2.0)]], preset=preset)
    result = record(tmp_path / "out", settled)
    assert result.task["places_done"] == (0 if needed else 1)
    assert result.warnings == warned(settled) == ((
        f"robot r1 starts {start[0]:.2f} m from a wall, at ({start[0]:.2f}, 2.00); the local planner of "
        f"navigation `chapter` cannot drive off from there: it needs {needed} m",
    ) if needed else ())  # fmt: skip


def test_places_near_walls(tmp_path: Path) -> None:
    rooms(tmp_path)
    settled = scenario(tmp_path, [(1.0, 1.0, 0.0)], [[(5.85, 2.0)]])
    assert warned(settled) == (
        "place r1/0 is 0.15 m from a wall; navigation `robust` needs 0.26 m, so that the robot visits it "
        "from a distance, within its reach of 0.5 m",
    )
    assert record(tmp_path / "out", settled).task["places_done"] == 1
    near = scenario(tmp_path, [(1.0, 1.0, 0.0)], [[(5.9, 2.0)]], "[strategy]\nreach = 0.1\n", "chapter")
    assert warned(near) == (
        "place r1/0 is 0.10 m from a wall; navigation `chapter` needs 0.27 m, but no point within the "
        "robot's reach of 0.1 m has that much",
    )


@pytest.mark.parametrize(
    ("preset", "cell", "width", "needed"),
    [
        ("robust", 0.1, 0.5, "0.60"),
        ("robust", 0.02, 0.2, "0.56"),
        ("chapter", 0.05, 0.5, "0.53"),
        ("chapter", 0.1, 0.6, None),
        ("robust", 0.05, 0.6, None),
    ],
)
def test_narrow_doors(preset: str, cell: float, width: float, needed: str | None, tmp_path: Path) -> None:
    rooms(tmp_path, cell, width)
    settled = scenario(tmp_path, [(1.5, 2.3, 1.0)], [[(5.2, 1.7), (1.0, 1.0), (5.0, 3.0)]], preset=preset)
    told = warned(settled)
    assert len(told) == (1 if needed else 0)
    for sentence in told:
        assert sentence.startswith("the door at (3.0")
        assert sentence.endswith(
            f"{width:.2f} m wide, is too narrow for robots of 0.354 m with navigation `{preset}`, which "
            f"needs {needed} m: robots may not get to places r1/0, r1/2"
        )


def test_rooms_without_a_path_or_a_radio_link(tmp_path: Path) -> None:
    rooms(tmp_path, door=0.0)
    apart = [(1.5, 2.0, 0.0), (5.0, 1.0, 0.0)]
    settled = scenario(tmp_path, apart, [[(5.0, 2.0)], [(4.0, 1.0)]], strategy="chapter")
    assert warned(settled) == (
        "no path leads from the start of robot r1 at (1.50, 2.00) to place r1/0",
        "navigation `robust` finds no path between the parts of the floor where r2 and r1 start",
    )
    rooms(tmp_path, door=0.0, thick=1.0)
    walls = '[radio]\nwalls = "concrete"\n'
    inside = scenario(tmp_path, apart, [[(1.0, 1.0)], [(5.0, 2.0)]], walls, strategy="chapter")
    assert warned(inside) == (
        "navigation `robust` finds no path between the parts of the floor where r2 and r1 start",
        "no radio frame reaches the floor of r1 from that of r2",
    )


def test_a_door_that_is_never_reopened(tmp_path: Path) -> None:
    rooms(tmp_path, door=1.0)
    closes = "[[event]]\nat = 5.0\nclose = [3.1, 2.0]\n"
    places = [[(5.0, 2.0), (1.0, 3.0)]]
    settled = scenario(tmp_path, [(1.5, 2.0, 0.0)], places, closes)
    sentence = "no event reopens the doors closed by 5 s: no path then leads to place r1/0"
    assert warned(settled) == (sentence,)
    found = survey(resolve(settled))
    assert json_content(found)["warnings"] == (sentence,) and f"warning: {sentence}" in sentences(found)
    again = "[[event]]\nat = 15.0\nopen = [3.1, 2.0]\n"
    assert warned(scenario(tmp_path, [(1.5, 2.0, 0.0)], places, closes + again)) == ()


@pytest.mark.parametrize("name", sorted(path.stem for path in (SHIPPED / "scenarios").glob("*.toml")))
def test_shipped_scenarios_have_no_warnings(name: str) -> None:
    assert warned(load_scenario(SHIPPED / "scenarios" / f"{name}.toml", Overrides())) == ()
