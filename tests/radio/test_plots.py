"""Figures of the documentation."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from acrc_testbed.benchmarks import radio as benchmark
from acrc_testbed.benchmarks.radio import MEASURED_LINKS, PlotTask
from actors.installation.repository import REPOSITORY

NAMES = ["reach.svg", "error_rate.svg", "grey_zone.svg", "wifi.svg", "contention.svg", "corridor.png"]
SVG = "{http://www.w3.org/2000/svg}"


def test_the_figures_are_drawn(tmp_path: Path) -> None:
    task = PlotTask(frames=10, places=50, seeds=1, senders=(2,))
    found = benchmark.draw(tmp_path, REPOSITORY / "maps" / "corridor.yaml", task=task)
    assert found.figures == {"written": [str(tmp_path / name) for name in NAMES], "reference": False}
    assert found.shown[-1] == "Results of ns-3 not drawn: --data is missing."
    for name in NAMES[:-1]:
        keyed_uniform = ElementTree.fromstring((tmp_path / name).read_text())
        lines = [one for one in keyed_uniform.iter(f"{SVG}g") if one.get("id", "").startswith("line2d")]
        assert len([one for one in lines if one.find(f"{SVG}path") is not None]) >= 3
    with Image.open(tmp_path / NAMES[-1]) as image:
        assert image.size == (705, 357)
        colours = {image.getpixel((x, y)) for x in range(image.width) for y in range(0, image.height, 3)}
    assert {(0, 0, 0), (255, 255, 255), (230, 150, 130)} <= colours


def test_a_tag_costs_its_bytes_and_at_most_one_frame() -> None:
    for text in (40, 90, 190):
        plain, *tagged = (benchmark.authentication_cost(text, tag) for tag in (0, 4, 8, 16))
        for one in tagged:
            assert one["packet"] == plain["packet"] + one["tag"]
            frames = one["frames"] - plain["frames"]
            octets = one["tag"] + frames * (9 + 9 + 6)  # headers of fragment, MAC and PHY
            assert frames in {0, 1} and one["air time, ms"] - plain["air time, ms"] == pytest.approx(
                octets * 0.032
            )
            assert one["verification, µs"] > plain["verification, µs"] == 0


def test_the_page_shows_every_figure_of_the_command() -> None:
    page = (REPOSITORY / "docs" / "radio.md").read_text()
    for name in NAMES:
        assert f"(radio/{name})" in page and (REPOSITORY / "docs" / "radio" / name).is_file()


@pytest.mark.claim("links")
def test_shadowing_of_6_db_makes_links_as_measured_ones() -> None:
    powers, shares = benchmark.grey_zone(6.0)
    own = {power: float(np.interp(power, powers, shares)) for power in MEASURED_LINKS}
    above = [power for power, measured in MEASURED_LINKS.items() if measured >= 0.7]
    assert [own[power] for power in above] == pytest.approx([MEASURED_LINKS[p] for p in above], abs=0.06)
    below = [power for power in MEASURED_LINKS if power not in above]
    assert all(own[power] > MEASURED_LINKS[power] for power in below)  # measured links end 2.5 dB sooner
