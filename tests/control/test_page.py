"""The map page in a real browser, beside a real run: a robot is dragged, the run paused, stepped, resumed."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from actors.installation.repository import REPOSITORY
from actors.messages import CONTROL, TRUTH, Control, Truth
from actors.orders import Move, Pause, Resume, Step, Stop, Wall
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.runtime.recording import Entry, read_recording
from tests.swarm.command import begin, leftovers, processes_of

browser = pytest.importorskip("tests.control.browser", reason="websockets comes with `./acrc run --control`")
pytestmark = pytest.mark.skipif(browser.CHROMIUM is None, reason="there is no Chromium on this machine")


@pytest.fixture
def run(tmp_path: Path) -> Iterator[tuple[Any, Path]]:
    out = tmp_path / "out"
    scenario = REPOSITORY / "scenarios" / "head_on.toml"
    process = begin("run", scenario, "--control", "--speed", 3, "--duration", 1000, "--out", out, "--json")
    try:
        browser.until((out / "control.url").exists, 90)
        yield process, out
    finally:
        process.kill()


def test_a_robot_is_dragged_and_the_run_is_paused_stepped_and_resumed(
    run: tuple[Any, Path], tmp_path: Path
) -> None:
    process, out = run
    with browser.Browser(tmp_path / "home", (out / "control.url").read_text()) as page:
        browser.until(lambda: page.value("floor && walls && state && state.step > 2"))
        assert page.value("$('speed').value") == "3"
        page.click("#pause")
        browser.until(lambda: page.value("state.paused && $('pause').textContent == 'Resume'"))
        paused = page.value("state.step")

        box = page.value("[canvas.getBoundingClientRect().x, canvas.getBoundingClientRect().y]")

        def there(x: float, y: float) -> tuple[float, float]:
            px, py = page.value(f"toScreen({x}, {y})")
            return box[0] + px, box[1] + py

        _, x, y, *_ = page.value("state.robots[0]")
        page.drag(there(x, y), there(x, y - 1.0))
        line = "$('said').firstChild.textContent"
        browser.until(lambda: page.value(f"{line}.startsWith('move r1') && !{line}.endsWith('waits')"))
        assert page.value(f"{line}.endsWith('carried out')")
        moved = page.value("state.robots[0]")
        assert abs(moved[2] - (y - 1.0)) < 0.05

        page.click("[data-tool=wall]")
        page.drag(there(x - 0.5, y + 0.6), there(x + 0.5, y + 0.6))
        browser.until(lambda: page.value("state.walls.length == 1"))
        page.click("#step")
        browser.until(lambda: page.value(f"state.step == {paused + 1} && state.paused"))
        page.click("#pause")
        browser.until(lambda: page.value(f"state.step > {paused} + 3"))
        browser.until(lambda: page.value("state.links.length == 1 && trails.get('r1').length > 1"))
        assert page.value("state.robots[0][5]") == [9.0, 12.5], "the first of the places that r1 has"
        for scheme in ("light", "dark"):
            page.scheme(scheme)
            assert page.value(_COLOURS) > 20, f"the map is blank in {scheme}"
            page.picture(tmp_path / f"{scheme}.png")
        page.click("#stop")
        browser.until(lambda: page.value("$('stop').textContent == 'Stop: sure?'"))
        before = page.value("state.step")
        browser.until(lambda: page.value(f"state.step > {before}"))
        page.click("#stop")
        browser.until(lambda: page.value("!$('lost').hidden && $('lost').textContent == 'The run is over.'"))
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert processes_of(out) == [] and leftovers(out) == [] and not (out / "control.url").exists()
    given = [order for told in _received(out / "world/world.mcap", CONTROL.key()) for order in told.orders]
    assert [type(one) for one in given] == [Pause, Move, Wall, Step, Resume, Stop]
    at_r1 = {
        told.step: told.robots[0] for told in _received(out / "radio/radio.mcap", TRUTH.key()) if told.robots
    }
    assert abs(at_r1[paused + 1].y - moved[2]) < 0.2 < abs(at_r1[paused].y - moved[2])


_COLOURS = """(() => {
  draw();
  const seen = new Set(), data = pen.getImageData(0, 0, canvas.width, canvas.height).data;
  for (let i = 0; i < data.length; i += 4) seen.add(data.slice(i, i + 4).join());
  return seen.size;
})()"""


def _received(path: Path, key: str) -> list[Any]:
    found = []
    for item in read_recording(path):
        if isinstance(item, Entry) and item.direction == "in" and item.key == key:
            assert item.payload is not None
            topic = at(CONTROL).topic if key == CONTROL.key() else at(TRUTH).topic
            told = decode(topic, key, item.payload)
            assert isinstance(told, Control | Truth)
            found.append(told)
    return found
