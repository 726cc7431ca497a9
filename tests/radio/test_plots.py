"""The figures of the documentation: drawn, and with everything in them."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from actors.installation.repository import REPOSITORY
from benchmarks.radio import plots
from benchmarks.radio.plots import PlotTask
from benchmarks.radio.svg_chart import Axis, Series, chart

SVG = "{http://www.w3.org/2000/svg}"
X = Axis("x", 1.0, 100.0, (1, 10, 100), logarithmic=True)
Y = Axis("y", 0.0, 1.0, (0, 1))


def test_a_chart_has_its_points_where_the_axes_say() -> None:
    text = chart(
        "a < b",
        X,
        Y,
        [Series("line", (1, 10, 100), (0, 0.5, 1), 0), Series("", (10, 1000), (0.5, 1), 1, True)],
    )
    root = ElementTree.fromstring(text)
    line = root.find(f"{SVG}polyline")
    assert line is not None
    assert line.get("points") == "64.0,324.0 322.0,182.0 580.0,40.0"
    dots = [(dot.get("cx"), dot.get("cy")) for dot in root.iter(f"{SVG}circle")]
    assert dots == [("322.0", "182.0")]  # the other one lies outside
    words = [element.text for element in root.iter(f"{SVG}text")]
    assert "a < b" in words and "line" in words and "" not in words


def test_the_figures_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    task = PlotTask(frames=10, places=50, seeds=1, senders=(2,))
    plots.run(tmp_path, REPOSITORY / "maps" / "corridor.yaml", None, False, task)
    names = ["reach.svg", "error_rate.svg", "grey_zone.svg", "wifi.svg", "contention.svg", "corridor.png"]
    said = capsys.readouterr().out.splitlines()
    assert said[:-1] == [str(tmp_path / name) for name in names]
    assert said[-1] == "Without the dots of ns-3, whose figures --data gives."
    for name in names[:-1]:
        drawn = ElementTree.fromstring((tmp_path / name).read_text())
        assert len(list(drawn.iter(f"{SVG}polyline"))) >= 3
    with Image.open(tmp_path / names[-1]) as image:
        assert image.size == (705, 357)
        colours = {image.getpixel((x, y)) for x in range(image.width) for y in range(0, image.height, 3)}
    assert {(0, 0, 0), (255, 255, 255), (230, 150, 130)} <= colours


def test_the_page_shows_every_figure_of_the_command() -> None:
    page = (REPOSITORY / "docs" / "radio.md").read_text()
    for name in (
        "reach.svg",
        "error_rate.svg",
        "grey_zone.svg",
        "wifi.svg",
        "contention.svg",
        "corridor.png",
    ):
        assert f"(radio/{name})" in page and (REPOSITORY / "docs" / "radio" / name).is_file()
