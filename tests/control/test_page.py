"""The map page in a real browser with a real run."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from acrc_testbed.run_model.recording_readers import messages_on
from actors.installation.repository import REPOSITORY
from actors.messages import CONTROL, TRUTH
from actors.orders import Move, Pause, Resume, Step, Stop, Wall
from actors.task.task import SYMBOLS
from tests.swarm.command import begin, leftovers, processes_of

browser = pytest.importorskip("tests.control.browser", reason="websockets comes with `./acrc run --control`")
pytestmark = pytest.mark.skipif(browser.CHROMIUM is None, reason="there is no Chromium on this machine")


@contextmanager
def begun(out: Path) -> Iterator[Any]:
    """Start a run with a page, and end it."""
    scenario = REPOSITORY / "scenarios" / "head_on.toml"
    process = begin("run", scenario, "--control", "--speed", 3, "--duration", 10_000, "--out", out, "--json")
    try:
        browser.until((out / "control.url").exists, 90)
        yield process
    finally:
        process.kill()


def test_a_robot_is_dragged_and_the_run_is_paused_stepped_and_resumed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with begun(out) as process, browser.Browser(tmp_path / "home", (out / "control.url").read_text()) as page:
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
        line = "$('orders').firstChild.textContent"
        browser.until(lambda: page.value(f"{line}.startsWith('move r1') && !{line}.endsWith('pending')"))
        assert page.value(f"{line}.endsWith('carried out')")
        moved = page.value("state.robots[0]")
        assert abs(moved[2] - (y - 1.0)) < 0.05

        page.click("[data-tool=wall]")
        page.drag(there(x - 0.5, y + 0.6), there(x + 0.5, y + 0.6))
        browser.until(lambda: len(things(page, "wall")) == 1)
        page.click("#step")
        browser.until(lambda: page.value(f"state.step == {paused + 1} && state.paused"))
        page.click("#pause")
        browser.until(lambda: page.value(f"state.step > {paused} + 3"))
        browser.until(lambda: page.value("state.links.length == 1 && trails.get('r1').length > 1"))
        assert page.value("state.robots[0][5]") == [9.0, 12.5], "the first of the items that r1 has"
        assert page.value("document.querySelector('[data-tool=give]').textContent") == "Place"
        assert page.value("state.items.length") == 6 and page.value("$('item').hidden")
        for scheme in ("light", "dark"):
            page.scheme(scheme)
            assert page.value(_COLOURS) > 20, f"the map is blank in {scheme}"
            page.picture(tmp_path / f"{scheme}.png")
        page.click("#stop")
        browser.until(lambda: page.value("$('stop').textContent == 'Stop: confirm'"))
        before = page.value("state.step")
        browser.until(lambda: page.value(f"state.step > {before}"))
        page.click("#stop")
        browser.until(lambda: page.value("$('lost').textContent == 'The run has ended.'"))
        process.communicate(timeout=60)
        assert process.returncode == 0
    assert processes_of(out) == [] and leftovers(out) == [] and not (out / "control.url").exists()
    given = [order for _, told in messages_on(out / "world/world.mcap", CONTROL) for order in told.orders]
    assert [type(one) for one in given] == [Pause, Move, Wall, Step, Resume, Stop]
    truths = messages_on(out / "radio/radio.mcap", TRUTH)
    at_r1 = {told.step: told.robots[0] for _, told in truths if told.robots}
    assert abs(at_r1[paused + 1].y - moved[2]) < 0.2 < abs(at_r1[paused].y - moved[2])


def things(page: Any, kind: str) -> Any:
    return page.value(f"state.things.filter(([kind]) => kind === '{kind}')")


_COLOURS = """(() => {
  draw();
  const seen = new Set(), data = pen.getImageData(0, 0, canvas.width, canvas.height).data;
  for (let i = 0; i < data.length; i += 4) seen.add(data.slice(i, i + 4).join());
  return seen.size;
})()"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of the page of a run that lasts for all tests of this module."""
    out = tmp_path_factory.mktemp("run") / "out"
    with begun(out):
        yield (out / "control.url").read_text()


@pytest.fixture(scope="module")
def window(address: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with browser.Browser(tmp_path_factory.mktemp("home"), address) as page:
        yield page


@pytest.fixture
def page(window: Any, address: str) -> Any:
    """Reload the page of the paused run, with all robots running."""
    load(window, address)
    if not window.value("state.paused"):
        window.click("#pause")
        browser.until(lambda: window.value("state.paused"))
    for robot, _, _, _, state, *_ in window.value("state.robots"):
        if state in ("off", "frozen"):
            window.value(f"order('{'restart' if state == 'off' else 'thaw'} {robot}')")
            browser.until(lambda: window.value("state.robots.every(([, , , , word]) => goes(word))"))
    return window


def load(window: Any, address: str) -> None:
    window.size(1280, 800)
    window.call("Page.navigate", url="about:blank")
    window.call("Page.navigate", url=address)
    browser.until(lambda: window.value("floor && walls && state && state.step > 2 && true"))


def there(page: Any, x: float, y: float) -> tuple[float, float]:
    """Return the window position of a point on the floor, px."""
    px, py, left, top = page.value(
        f"(() => {{ fit(); const b = canvas.getBoundingClientRect(); "
        f"return [...toScreen({x}, {y}), b.x, b.y]; }})()"
    )
    return left + px, top + py


def robot(page: Any, index: int = 0) -> Any:
    return page.value(f"state.robots[{index}]")


@pytest.mark.nightly
def test_keyboard_control(page: Any) -> None:
    _, x, y, *_ = robot(page)
    page.press("n")
    assert page.value("chosen") == "r1"
    for key in ("ArrowLeft", "ArrowLeft", "ArrowDown"):
        page.press(key)
    browser.until(lambda: robot(page)[1:3] == pytest.approx([x - 0.2, y - 0.1], abs=2e-3))
    line = "$('orders').firstChild.textContent"
    browser.until(lambda: page.value(f"{line}.startsWith('move r1') && {line}.endsWith('carried out')"))

    walls = len(things(page, "wall"))
    for key in ("w", "Enter", "ArrowRight", "ArrowRight", "Enter"):
        page.press(key)
    browser.until(lambda: len(things(page, "wall")) == walls + 1)
    (from_x, from_y), (to_x, to_y) = things(page, "wall")[-1][1]
    assert (to_x - from_x, to_y) == (pytest.approx(0.4, abs=2e-3), from_y)

    paused = page.value("state.step")
    page.press(".")
    browser.until(lambda: page.value(f"state.step == {paused + 1} && state.paused"))
    page.press("f")
    browser.until(lambda: robot(page)[4] == "frozen")
    page.press("f")
    assert page.value("$('note').textContent") == "Cannot freeze r1: it is frozen."
    page.press("t")
    browser.until(lambda: robot(page)[4] == "driving")
    heading = robot(page)[3]
    page.press("q")
    browser.until(lambda: (robot(page)[3] - heading) % 6.283185 == pytest.approx(3.141593 / 12, abs=2e-3))
    page.press("]")
    browser.until(lambda: page.value("state.speed") == 4 and page.value("$('speed').value") == "4")
    page.press("x")
    assert page.value("$('stop').textContent") == "Stop: confirm"
    page.press("Escape")
    assert page.value("$('stop').textContent") == "Stop"
    page.press(" ")
    browser.until(lambda: page.value(f"!state.paused && state.step > {paused + 3}"))


@pytest.mark.nightly
def test_doors_and_new_obstacles_are_drawn(page: Any) -> None:
    assert page.value("floor.doors.length") == 5
    (x, y), (to_x, to_y) = page.value("floor.doors[2]")
    beside = there(page, (x + to_x) / 2 + 0.6, (y + to_y) / 2)
    before = page.value("canvas.toDataURL()")
    page.click("[data-tool=door]")
    page.drag(beside, beside)
    browser.until(lambda: page.value("floor.doors.map(isShut).join()") == "false,false,true,false,false")
    assert page.value("draw() || canvas.toDataURL()") != before
    page.drag(beside, beside)
    browser.until(lambda: page.value("!floor.doors.some(isShut)"))

    page.click("[data-tool=jam]")
    page.drag(there(page, 9.0, 12.0), there(page, 9.0, 13.0))
    page.press(".")
    browser.until(lambda: len(things(page, "jammer")) == 1)
    _, _, radius, left = things(page, "jammer")[0]
    assert radius == pytest.approx(1.0, abs=0.05) and 19 < left <= 20
    page.click("[data-tool=obstacle]")
    page.drag(there(page, 4.0, 12.0), there(page, 4.0, 12.3))
    page.press("n")
    page.click("[data-tool=give]")
    page.drag(there(page, 10.0, 12.0), there(page, 10.0, 12.0))
    browser.until(
        lambda: (
            len(things(page, "obstacle")) == 1
            and page.value("state.items.some(([, , , stands]) => stands === 'given')")
        )
    )
    page.click("[data-tool=move]")
    assert page.value("document.activeElement.id") == "map", "keys go there"
    page.press("k")
    browser.until(lambda: robot(page)[4] == "off")
    assert page.value("(() => { draw(); drawLegend(); return 'drawn'; })()") == "drawn"
    known = page.value("Object.keys(SHAPES)")
    assert {*SYMBOLS} <= {*known}
    assert page.value("Object.values(floor.legend).every(([shape]) => shape in SHAPES)")
    assert page.value("Object.keys(floor.marks)") == ["open", "given", "done", "given up"]
    assert (
        page.value("$('legend').children.length") == page.value("Object.keys(floor.legend).length") + 4 == 15
    )


@pytest.mark.nightly
def test_items_that_are_no_points_are_given_as_json_text(page: Any) -> None:
    page.value("floor.is_point = false, floor.item = '<i>order', nameItems()")
    assert page.value("document.querySelector('[data-tool=give]').textContent") == "<i>order"
    page.click("[data-tool=give]")
    assert page.value("$('note').textContent") == "Select the robot of the <i>order first."
    page.press("n")
    page.click("[data-tool=give]")
    assert page.value("$('note').textContent") == "Enter the <i>order as JSON text beside its button."
    page.value("$('item').value = '[10, 12]', give()")
    browser.until(lambda: page.value("$('orders').firstChild.textContent") == "give r1 [10,12]: carried out")
    assert page.value("state.items.at(-1).slice(0, 4)") == ["r1", 10, 12, "given"]


@pytest.mark.nightly
def test_reload_and_two_tabs_show_the_same(page: Any, address: str, tmp_path: Path) -> None:
    for _ in range(3):
        page.value("order('step')")
    texts = "[...$('orders').children].map((one) => one.textContent)"
    browser.until(lambda: page.value("$('orders').firstChild.textContent == 'step \\u00d73: carried out'"))
    told = page.value(texts)
    trail = page.value("trails.get('r1').slice(0, 5)")
    load(page, address)
    browser.until(lambda: page.value(texts) == told)
    assert page.value("trails.get('r1').slice(0, 5)") == trail
    with browser.Browser(tmp_path / "home", address) as other:
        browser.until(lambda: other.value("state && true") and other.value(texts) == told)
        other.value("order('thaw r1')")
        refused = "thaw r1: refused: "
        for one in (page, other):
            browser.until(lambda one=one: one.value("$('orders').firstChild.textContent").startswith(refused))
        assert page.value(texts) == other.value(texts)


@pytest.mark.nightly
def test_touch_on_a_phone_moves_robots_and_the_view(page: Any, tmp_path: Path) -> None:
    page.size(390, 844, mobile=True)
    browser.until(lambda: page.value("innerWidth == 390"))
    assert page.value("document.documentElement.scrollWidth") == 390
    page.value("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert page.value("document.documentElement.scrollWidth") == 390
    page.picture(tmp_path / "phone.png")
    assert page.value("getComputedStyle(canvas).touchAction") == "none"

    _, x, y, *_ = robot(page)
    page.touch([there(page, x, y)], [there(page, x, y - 0.5)], [there(page, x, y - 1.0)])
    browser.until(lambda: robot(page)[2] == pytest.approx(y - 1.0, abs=0.1))
    fit = page.value("fit() || scale")
    cx, cy = there(page, x, y)
    said = page.value("$('orders').children.length")
    page.touch([(cx - 30, cy), (cx + 30, cy)], [(cx - 60, cy), (cx + 60, cy)])
    assert page.value("fit() || scale") == pytest.approx(2 * fit, rel=0.05)
    at = page.value("fit() || left")
    page.touch([(cx - 60, cy), (cx + 60, cy)], [(cx - 40, cy), (cx + 80, cy)])
    assert page.value("fit() || left") == pytest.approx(at + 20, abs=2)
    assert page.value("$('orders').children.length") == said
    page.click("#whole")
    assert page.value("fit() || scale") == pytest.approx(fit)


@pytest.mark.nightly
@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (390, "light")])
def test_axe_finds_nothing_wrong(page: Any, width: int, scheme: str) -> None:
    axe = pytest.importorskip("axe_core_python", reason="axe-core-python comes with the extra dev")
    page.size(width, 844, mobile=width < 500)
    page.scheme(scheme)
    page.click("[data-robot=r1]")
    page.click("[data-tool=wall]")
    page.value("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    page.value("order('thaw r1')")
    browser.until(lambda: page.value("document.querySelector('#orders .no') && $('note').textContent != ''"))
    page.call(
        "Runtime.evaluate", expression=resources.files(axe).joinpath("axe.min.js").read_text(encoding="utf-8")
    )
    told = json.loads(
        page.value(
            "axe.run().then((found) => JSON.stringify({ tried: found.passes.map((one) => one.id), "
            "wrong: found.violations.map((one) => "
            "[one.id, one.nodes.map((node) => node.html + node.failureSummary)]) }))"
        )
    )
    assert told["wrong"] == []
    assert {"color-contrast", "button-name", "label", "aria-allowed-role"} <= set(told["tried"])
