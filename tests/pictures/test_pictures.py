"""Pictures have what they are for, look the same every time, and are made by commands."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from deploy.evidence.run_evidence import RunEvidence
from deploy.picture import floor_picture, run_page, side_by_side, style
from tests.swarm.command import acrc


def colours(path: Path) -> set[tuple[int, int, int]]:
    with Image.open(path) as image:
        return set(map(tuple, np.asarray(image.convert("RGB")).reshape(-1, 3).tolist()))


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def test_a_page_shows_floor_robots_and_what_they_did(evidence: RunEvidence, tmp_path: Path) -> None:
    run_page.write(evidence, tmp_path / "run.png")
    seen = colours(tmp_path / "run.png")
    wanted = [style.WALL, style.UNKNOWN, style.colour(0), style.colour(1), *map(style.DOING.get, style.DOING)]
    shown = [colour for colour in wanted if colour is not None and rgb(colour) in seen]
    assert len(shown) >= 8, "walls, both robots, and the kinds of spells that there are"


def test_a_page_says_what_run_it_is(evidence: RunEvidence) -> None:
    figure = run_page.draw(evidence)
    assert figure.axes[0].get_title(loc="left") == (
        f"chapter: 6 of 6 places in 98.6 s   (2 robots, seed 1, digest {evidence.result.digest[:8]})"  # type: ignore[union-attr]
    )
    assert [label.get_text() for label in figure.axes[1].get_yticklabels()] == ["r1", "r2"]
    assert figure.axes[2].get_ylabel() == "radio frames/s"


@pytest.mark.parametrize("name", ["a.png", "a.svg"])
def test_the_same_run_gives_the_same_bytes(evidence: RunEvidence, tmp_path: Path, name: str) -> None:
    first, second = tmp_path / name, tmp_path / f"b{name}"
    run_page.write(evidence, first)
    run_page.write(evidence, second)
    assert first.read_bytes() == second.read_bytes()


def test_runs_beside_each_other_have_one_scale_of_time(evidence: RunEvidence) -> None:
    figure = side_by_side.draw([evidence, evidence])
    floors, lanes = figure.axes[::2], figure.axes[1::2]
    assert {axes.get_xlim() for axes in lanes} == {(0.0, evidence.end)}
    assert all(axes.get_title(loc="left") == "chapter: 6 of 6 places in 98.6 s" for axes in floors)
    low, high = floors[0].get_xlim()
    assert low <= evidence.true[..., 0].min() and evidence.true[..., 0].max() <= high


def test_robots_beyond_the_palette_have_a_colour_too() -> None:
    assert style.colour(len(style.ROBOTS)) == style.colour(0)
    assert not style.few([f"r{n}" for n in range(13)])
    assert len({line.get_label() for line in floor_picture.legend()}) == 5


def test_view_draws_beside_the_run(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "copy"
    shutil.copytree(folder, out)
    done = acrc("view", out, "--png", "--svg")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [str(out / "run.png"), str(out / "run.svg")]
    assert (out / "run.svg").read_text().startswith("<?xml")


def test_view_says_what_it_needs(folder: Path, tmp_path: Path) -> None:
    nothing = acrc("view", tmp_path, "--png")
    assert nothing.returncode == 1
    assert nothing.stderr == f"acrc: {tmp_path}: no run's folder: there is no */*.mcap in it\n"


def test_the_demonstration_shows_the_problem_and_its_cure(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    done = acrc("demo", "--out", out)
    assert done.returncode == 0, done.stderr
    without, adapted, pictures = done.stdout.splitlines()
    assert without == (
        "Without adaptation: 0 of 6 places are clean by 200 s. One robot wants out of the office, one wants "
        "in, and neither gives way."
    )
    assert adapted == (
        "With the chapter's adaptation: 6 of 6 places are clean by 98.6 s. Who is blocked tells the other by "
        "radio, and they exchange where they go: 4 places changed hands."
    )
    assert pictures == f"Both side by side: {out / 'demo.png'}, {out / 'demo.svg'}"
    assert {path.name for path in out.iterdir()} == {"none", "chapter", "demo.png", "demo.svg"}
    with Image.open(out / "demo.png") as image:
        assert image.size[0] > 1000
    again = acrc("demo", "--out", out)
    assert again.returncode == 2
    assert (
        again.stderr == f"acrc: --out: {out / 'none'} exists and is not an empty folder; must be a new one\n"
    )
