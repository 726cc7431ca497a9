import json
from pathlib import Path

import pytest

from actors.floor.map_file import MapError
from actors.geometry import Point
from benchmarks.world.map import PlanFigures, compare, map_in, run
from tests.floor.plans import plan

MAPS = Path(__file__).parents[2] / "maps"


def test_a_map_is_exactly_like_itself_at_any_resolution() -> None:
    coarse = plan("#..", "...", resolution=0.5, origin=Point(-1.0, 0.0))
    fine = plan("##....", "##....", "......", "......", resolution=0.25, origin=Point(-1.0, 0.0))
    likeness = compare(PlanFigures(coarse, coarse.free), PlanFigures(fine, fine.free))
    assert (likeness.area, likeness.reference_area, likeness.overlap) == (1.25, 1.25, 1.0)


def test_the_overlap_of_two_maps_that_lie_apart() -> None:
    one = plan("..", "..")
    other = plan("..", "..", origin=Point(1.0, 0.0))
    assert compare(PlanFigures(one, one.free), PlanFigures(other, other.free)).overlap == pytest.approx(1 / 3)
    for origin in (Point(-7.0, 0.0), Point(7.0, 0.0), Point(0.0, -9.0), Point(0.0, 9.0)):
        away = plan("..", "..", origin=origin)
        assert compare(PlanFigures(one, one.free), PlanFigures(away, away.free)).overlap == 0.0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the corridor's map alone."""
    for name in ("corridor.yaml", "corridor.png"):
        (tmp_path / name).symlink_to(MAPS / name)
    return tmp_path


def test_the_command_prints_areas_and_overlap(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(folder, MAPS / "corridor.yaml", json_output=True)
    printed = json.loads(capsys.readouterr().out)
    assert printed == {"area": printed["reference_area"], "reference_area": printed["area"], "overlap": 1.0}
    run(folder, MAPS / "corridor.yaml")
    text = capsys.readouterr().out
    assert f"{printed['area']:.2f} m²" in text and "1.0000" in text


def test_a_start_in_a_wall_is_refused(folder: Path) -> None:
    with pytest.raises(MapError) as caught:
        run(folder, MAPS / "corridor.yaml", start=Point(5.0, 12.5))
    assert str(caught.value) == (
        f"{MAPS}/corridor.yaml: the point (5, 12.5) is not free; start from one that is."
    )


def test_a_directory_without_a_map_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError) as caught:
        map_in(tmp_path)
    assert str(caught.value) == (
        f"{tmp_path}: a directory with exactly one *.yaml is needed, but this has none."
    )
    (tmp_path / "b.yaml").touch()
    (tmp_path / "a.yaml").touch()
    with pytest.raises(MapError) as caught:
        map_in(tmp_path)
    assert str(caught.value) == (
        f"{tmp_path}: a directory with exactly one *.yaml is needed, but this has a.yaml, b.yaml."
    )
