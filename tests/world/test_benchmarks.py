"""That the benchmarks of the world run and measure what they say; never how fast anything is."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from actors.floor.grid import FREE
from actors.floor.map_file import load_map
from benchmarks.world import navground_peer, scan, stage_peer, world

CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"


def test_scans_agree_with_pymunk_on_the_corridor(capsys: pytest.CaptureFixture[str]) -> None:
    task = scan.ScanTask(rays=(64, 640), robots=10, repeats=1, peer_repeats=1)
    figures = scan.run(CORRIDOR, json_output=True, task=task)
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(figures))
    for speed in figures["speeds"]:
        assert speed["median_difference_mm"] <= 0.5 and speed["disagreements"] < 0.002
    scan.run(CORRIDOR, task=task)
    assert "goal, at least 20 times pymunk, at most 5 mm:" in capsys.readouterr().out


def test_the_world_is_measured_beside_stage(capsys: pytest.CaptureFixture[str]) -> None:
    task = world.WorldTask(robots=(4, 20), rays=(60,), seconds_long=2, repeats=1)
    figures = world.run(CORRIDOR, task=task)
    printed = capsys.readouterr().out
    assert ("Stage is not installed: it was NOT measured." in printed) == (stage_peer.binary() is None)
    if stage_peer.binary() is None:
        assert [(speed["robots"], speed["stage"]) for speed in figures["speeds"]] == [(4, 422.0), (20, 61.0)]
    assert all(speed["speed"] > 0 and speed["ratio"] > 0 for speed in figures["speeds"])
    missing = navground_peer.version() is None
    assert ("navground is not installed: it was NOT measured." in printed) == missing
    assert "goal, never below Stage:" in printed and "goal, never below navground:" in printed
    figures = world.run(CORRIDOR, json_output=True, task=task)
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(figures))


FAKE = """#!{python}
import pathlib, re, sys
pathlib.Path({folder!r}, "words").write_text(" ".join(sys.argv[1:]))
text = pathlib.Path(sys.argv[-1]).read_text()
seconds = int(re.search(r"quit_time (\\d+)", text)[1])
robots = text.count("turtlebot( name")
sum(range(seconds * robots * 300_000))
print("Stage 4.3.0 [Clock enabled][GUI disabled]")
print(" [Loading x]")
for second in range(seconds):
    print(f"\\r[Stage:  0m {{second:02d}}s 000msec]", end="")
print("{end}")
"""


def fake(folder: Path, end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program `stage` that takes time and says what Stage says."""
    program = folder / "stage"
    program.write_text(FAKE.format(python=sys.executable, folder=str(folder), end=end))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)


def test_stage_is_run_without_a_window_on_our_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake(tmp_path, "\\n[Stage: done]", monkeypatch)
    grid = load_map(CORRIDOR)
    measured = stage_peer.speed(grid, robots=3, rays=60, seconds_long=4, repeats=1, seed=1)
    assert measured is not None and measured[0] == "4.3.0" and 0 < measured[1] < 1e4
    words = (tmp_path / "words").read_text().split()
    assert words[:2] == ["-g", "-c"] and words[2].endswith("swarm-5.world")
    path = stage_peer.write_world(grid, 3, 60, 5, 1, tmp_path)
    content = path.read_text()
    assert "quit_time 5" in content and content.count("turtlebot( name") == 3
    assert "sensor( range [0 5] fov 360 samples 60 )" in content
    with Image.open(tmp_path / "map.png") as image:
        assert image.size == (grid.columns, grid.rows)
        blocked = np.asarray(image)[::-1] == 0
    assert (blocked == (grid.cells != FREE)).all()


def test_a_stage_that_is_none_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake(tmp_path, "Segmentation fault", monkeypatch)
    with pytest.raises(stage_peer.StageError) as caught:
        stage_peer.speed(load_map(CORRIDOR), robots=1, rays=60, seconds_long=1, repeats=1, seed=1)
    assert str(caught.value).startswith("stage did not run to its end as Stage does; the last that it said:")
    assert stage_peer.read("Stage 4.3.0\n[Stage: 1h 2m 03s 500msec]\n[Stage: done]") == ("4.3.0", 3723.5)
