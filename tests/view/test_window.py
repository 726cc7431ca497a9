"""What a person sees: the real viewer, without a window, opens a view file and takes a picture of it."""

from collections import Counter
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from actors.observer import glyphs, screenshot
from observation.trace.rows import Trace
from observation.trace.traces import Traced
from observation.view import drawn
from observation.view.drawn import Wishes, draw, read_story

SHOWN = {
    "Swarm, ground truth": "3D",
    "r1: what it sees and plans": "3D",
    "What each robot does": "StateTimeline",
    "Places done": "TimeSeries",
    "Copies of frames per second, by fate": "TimeSeries",
    "Events": "TextLog",
    "Ensembles": "Graph",
    "r1: knowledge": "TextDocument",
}


@pytest.mark.nightly
def test_the_viewer_shows_it_all_and_finds_nothing_wrong(
    folder: Path, insides: dict[str, Trace], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    traced = [Traced(actor, (inside,)) for actor, inside in insides.items()]
    monkeypatch.setattr(drawn, "traces", lambda *words, **more: iter(traced))
    view = tmp_path / "view.rrd"
    draw(read_story(folder), view, Wishes(), send_to=None, say=lambda sentence: None)
    try:
        shot = screenshot.take(view, 20.0, 1200, 800)
    except screenshot.ScreenshotError as error:
        pytest.skip(f"what a person sees is not looked at: {error}")
    assert {one.name: one.kind for one in shot.views}.items() >= SHOWN.items()
    assert [one for one in shot.views if one.reports] == []
    picture = Image.open(BytesIO(shot.png)).convert("RGB")
    assert picture.size == (1200, 800)
    pixels = np.asarray(picture).astype(int)
    seen = Counter(map(tuple, pixels.reshape(-1, 3).tolist()))
    assert len(seen) > 500
    for colour in glyphs.ROBOTS[:2]:
        near = np.abs(pixels[:520, :800] - colour).max(axis=2) < 12
        assert near.sum() > 30, f"nothing on the floor has the colour {colour}"
    lanes = pixels[560:, :400]
    assert (lanes.max(axis=2) - lanes.min(axis=2) > 40).sum() > 2000, "no lane is coloured"
