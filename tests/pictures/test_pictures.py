"""Pictures, pages and movies of runs, and the commands that write them."""

import io
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from acrc_testbed.command_line import visualisation
from acrc_testbed.picture import floor_picture, marks, run_html, run_movie, run_page, style
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.simulated_runs import read_run
from actors.installation.usage import OptionError
from actors.messages import ItemMark, TaskEvent
from actors.observer import floor_drawing, glyphs
from actors.observer.glyphs import CAUSE_GLYPHS, MARKS, Mark, contrast, hexadecimal
from actors.runtime.errors import AcrcError
from actors.task.task import SYMBOLS, Column, MarkStyle, Metric, TaskDeclaration
from deploy.run import start
from tests.in_process import acrc

if TYPE_CHECKING:
    from tests.control.browser import Browser


def colours(file: Path | io.BytesIO) -> set[tuple[int, int, int]]:
    with Image.open(file) as image:
        return set(map(tuple, np.asarray(image.convert("RGB")).reshape(-1, 3).tolist()))


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


class Page(NamedTuple):
    """A run's page, drawn once for all tests."""

    figure: Figure
    png: bytes
    svg: bytes


@pytest.fixture(scope="module")
def page(evidence: RunData, tmp_path_factory: pytest.TempPathFactory) -> Page:
    folder = tmp_path_factory.mktemp("page")
    with style.context(style.LOOK):
        figure = run_page.draw(evidence)
        for kind in ("png", "svg"):
            style.save(figure, folder / f"run.{kind}")
    return Page(figure, *((folder / f"run.{kind}").read_bytes() for kind in ("png", "svg")))


def test_a_page_names_its_run_and_shows_floor_robots_and_causes(evidence: RunData, page: Page) -> None:
    seen = colours(io.BytesIO(page.png))
    causes = [hexadecimal(glyph.colour) for glyph in CAUSE_GLYPHS.values()]
    wanted = [style.WALL, style.UNKNOWN, style.colour(0), style.colour(1), *causes]
    assert sum(rgb(colour) in seen for colour in wanted) >= 8
    assert page.figure.axes[0].get_title(loc="left") == (
        f"chapter: 6 of 6 places in 99 s   (2 robots, seed 1, digest {evidence.result.digest[:8]})"  # type: ignore[union-attr]
    )
    assert [label.get_text() for label in page.figure.axes[1].get_yticklabels()] == ["r1", "r2"]
    assert page.figure.axes[2].get_ylabel() == "radio frames/s"


def test_runs_beside_each_other_have_one_scale_of_time(evidence: RunData) -> None:
    figure = run_page.draw_several([evidence, evidence])
    floors, lanes = figure.axes[::2], figure.axes[1::2]
    assert {axes.get_xlim() for axes in lanes} == {(0.0, evidence.end)}
    assert all(axes.get_title(loc="left") == "chapter: 6 of 6 places in 99 s" for axes in floors)
    low, high = floors[0].get_xlim()
    assert low <= evidence.true[..., 0].min() and evidence.true[..., 0].max() <= high


def test_robots_beyond_the_palette_have_a_colour_too() -> None:
    assert style.colour(len(style.ROBOTS)) == style.colour(0)
    assert not glyphs.is_small_swarm([f"r{n}" for n in range(13)])
    assert len({mark.get_label() for mark in floor_picture.legend(MARKS.values(), ())}) == len(MARKS)


def test_view_draws_page_and_movie(evidence: RunData, page: Page, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "copy"
    shutil.copytree(folder, out)
    done = acrc("view", out, "--png", "--svg", "--html", "--movie", tmp_path / "m.gif", "--speed", 100)
    assert done.returncode == 0, done.stderr
    files = [out / f"run.{kind}" for kind in ("png", "svg", "html")] + [tmp_path / "m.gif"]
    assert done.stdout.splitlines() == list(map(str, files))
    assert (files[0].read_bytes(), files[1].read_bytes()) == (page.png, page.svg)

    html = files[2].read_text()
    assert html.startswith("<!DOCTYPE html>") and html.count("data:image/svg+xml;base64,") == 1
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", html) and "<script" not in html
    cleaned = (
        "2 robots with strategy chapter and navigation chapter cleaned all 6 places "
        "in 99 s of simulated time."
    )
    assert f"<p>{cleaned}</p>" in html
    headings = re.findall(r"<h2 id=\"s(\d)\">", html)
    assert headings == [str(number) for number in range(1, len(headings) + 1)] and len(headings) == 8
    assert html.count("<td>takes over ") == len(evidence.taken_over)
    assert html.count("<td>done</td>") == 6 and str(out) not in html

    shown = list(run_movie.instants(evidence, 100.0))
    assert shown[-1] == len(evidence.seconds) - 1
    with Image.open(files[3]) as movie:
        assert getattr(movie, "n_frames", 0) == len(shown) == 11 and movie.info["duration"] == 100
        frames = []
        for number in (0, len(shown) - 1):
            movie.seek(number)
            frames.append(np.asarray(movie.convert("RGB")).astype(int))
    assert (np.abs(frames[1] - frames[0]).sum(axis=2) > 100).sum() > 200


@pytest.mark.parametrize(
    ("words", "folder", "files"),
    [
        ("runs/a", "runs/a", {}),
        ("runs/a page.html", "runs/a", {".html": "page.html"}),
        ("x.png runs/a y.html", "runs/a", {".png": "x.png", ".html": "y.html"}),
        ("x.svg", None, {".svg": "x.svg"}),
    ],
)
def test_pages_go_to_files_that_are_named(words: str, folder: str | None, files: dict[str, str]) -> None:
    found = visualisation._folder_and_files([Path(word) for word in words.split()])
    assert found == (folder and Path(folder), {suffix: Path(file) for suffix, file in files.items()})
    for wrong, sentence in (
        ("page.jpg", "view: unexpected argument page.jpg; a picture is a .* view runs/a --html page.html"),
        ("nowhere/a.png", "--png: nowhere/a.png; must be a file in an existing folder"),
    ):
        with pytest.raises(OptionError, match=sentence):
            visualisation._folder_and_files([Path("runs/a"), Path(wrong)])


def test_runs_too_short_to_judge_are_drawn_beside_one_another_with_a_warning(short_run_copy: Path) -> None:
    words = ("view", short_run_copy, "--beside", short_run_copy)
    warning = f"acrc: {short_run_copy}: the run lasts 3 s; statistics require at least 5 s\n"
    done = acrc(*words, "--svg")
    assert (done.returncode, done.stdout, done.stderr) == (
        0,
        f"{short_run_copy / 'beside.svg'}\n",
        warning * 2,
    )
    refused = acrc(*words, "--html")
    assert refused.returncode == 2
    assert refused.stderr == "acrc: --beside: cannot be combined with --html or --movie\n"


def test_texts_on_a_page_are_escaped(evidence: RunData) -> None:
    assert evidence.result is not None
    origin = msgspec.structs.replace(evidence.result.origin, strategy="<script>alert(1)</script>")
    result = msgspec.structs.replace(evidence.result, origin=origin)
    page = run_html.html(replace(evidence, result=result), b"")
    assert "<script" not in page and "&lt;script&gt;alert(1)" in page


ORDERS = TaskDeclaration(
    name="orders",
    table="orders",
    item="<i>order",
    items="<i>orders",
    done="delivered",
    metrics=(Metric("orders", "orders delivered", "<i>orders", "delivered", rank=1),),
    marks={
        "waiting": MarkStyle("square", "<b>waiting</b>", is_open=True),
        "odd": MarkStyle("heart", "no such symbol"),
        "delivered": MarkStyle("disc", "delivered"),
    },
    events={"delivered": MarkStyle("snowflake", "order delivered")},
    columns=(Column("<u>", "number", "a number"), Column("word", "text", "a word")),
    causes={"<s>charging": ("#0000fe", "//"), "odd cause": ("url(x)", "?")},
)


def test_a_run_of_any_task_is_drawn_by_its_declaration(evidence: RunData, tmp_path: Path) -> None:
    assert evidence.result is not None
    result = msgspec.structs.replace(evidence.result, task={"delivered": 1.5})
    run = replace(
        evidence,
        description=replace(evidence.description, task=ORDERS),
        result=result,
        marks=(
            (0.0, ItemMark("", 0, 9.0, 12.0, "waiting")),
            (0.0, ItemMark("", 1, 9.0, 13.0, "waiting")),
            (1.0, ItemMark("", 1, 9.0, 13.0, "")),
            (1.0, ItemMark("r9", 2, 9.0, 12.5, "odd")),
            (2.0, ItemMark("", 3, 9.0, 12.5, "unknown state")),
            (40.0, ItemMark("", 0, 10.0, 12.0, "delivered", "r2")),
        ),
        task_events=(
            TaskEvent("r1", 1_000_000, "<s>charging"),
            TaskEvent("r1", 30_000_000, "odd cause"),
            TaskEvent("r1", 31_000_000, ""),
            TaskEvent("r2", 40_000_000, "delivered", "", 0),
            TaskEvent("r7", 40_000_000, "delivered", "x", 0),
        ),
        items=({"<u>": 0.5, "word": "<a>"}, {}),
    )
    items = floor_picture.shown_items(run)
    assert [(one.mark.number, one.symbol.shape, one.is_filled) for one in items] == [
        (0, "square", True), (2, "ring", False),
    ]  # fmt: skip
    assert style.short_title(run) == f"chapter: 1.5 <i>orders in {result.simulated_s:g} s"
    with style.context(style.LOOK):
        figure = run_page.draw(run)
        style.save(figure, tmp_path / "run.png")
        drawn = style.svg(figure)
    assert (0, 0, 254) in colours(tmp_path / "run.png")
    said = {text.get_text() for axes in figure.axes for text in legend_texts(axes)}
    assert {"no such symbol", "<b>waiting</b>", "<s>charging", "odd cause", "order delivered"} <= said
    assert any("<i>orders delivered by each robot: 2" in axes.get_title(loc="left") for axes in figure.axes)
    page = run_html.html(run, drawn)
    assert "&lt;i&gt;orders</h2>" in page
    assert "<td>&lt;a&gt;</td>" in page and "0.50</td>" in page
    assert not re.search("<[iubs]>", page)
    run_movie.write(run, tmp_path / "m.gif", 200.0)


def test_each_symbol_has_its_own_form_in_pictures_and_in_the_viewer() -> None:
    forms = {str(marks.line_style(Mark(one, None, ""), "#000000", 5.0, "")) for one in SYMBOLS}
    assert len(forms) == len(SYMBOLS)
    assert {*SYMBOLS} - {"ring", "disc", "filled ring", "soft ring"} == {*floor_drawing._OUTLINES}
    assert {*SYMBOLS} <= {*floor_drawing._SIGNS}


def legend_texts(axes: Axes) -> list[Text]:
    legend = axes.get_legend()
    return [] if legend is None else legend.get_texts()


def test_a_run_without_a_result_was_cut_off_or_is_running(short_run_copy: Path) -> None:
    out = short_run_copy
    (out / "run.json").unlink()
    cut = read_run(out)
    html = run_html.html(cut, b"")
    assert "<p>The run was cut off; this page shows its first 3 simulated s.</p>" in html
    assert "Reproduction</h2>" not in html
    assert style.title(cut) == "2 robots, seed 1: cut off after 3 s"
    world = next((out / "world").glob("*.mcap"))
    world.write_bytes(world.read_bytes()[:-1000])
    with world.open("ab") as file:
        writer = subprocess.Popen(["sleep", "60"], stdout=file)
    try:
        drawn = acrc("view", out, "--html")
        assert style.title(cut) == "2 robots, seed 1: up to 3 s, still running"
    finally:
        writer.kill()
        writer.wait()
    told = re.search(r"the run is still running; drawn up to ([\d.]+) s\n", drawn.stderr)
    assert told is not None, drawn.stderr
    html = (out / "run.html").read_text()
    assert f"<h1>up to {told[1]} s, still running</h1>" in html
    said = f"<p>The run is still running; this page shows its first {told[1]} simulated s.</p>"
    assert said in html and "cut off" not in html
    assert acrc("view", out, "--png").stderr.startswith("the run was cut off; drawn up to ")


@pytest.mark.nightly
def test_a_page_on_a_dark_screen_is_dark(evidence: RunData, browser: "Browser", tmp_path: Path) -> None:
    run_html.write(evidence, tmp_path / "run.html")
    bright = {}
    for scheme in ("light", "dark"):
        browser.open((tmp_path / "run.html").as_uri(), scheme=scheme)
        browser.value("document.images[0].scrollIntoView()")
        with Image.open(io.BytesIO(browser.shot())) as image:
            bright[scheme] = float((np.asarray(image.convert("L")) > 127).mean())
    assert bright["light"] > 0.8 and bright["dark"] < 0.2, bright


def test_colours_on_a_dark_screen_have_enough_contrast(page: Page) -> None:
    drawn = style.svg(page.figure).decode()
    rules, shapes = drawn.split("@media (prefers-color-scheme: dark){")[1].split("</style>", 1)
    changed = dict(re.findall(r"fill: (#[0-9a-f]{6})\"\]\{fill:(#[0-9a-f]{6})", rules))
    assert changed[style.FLOOR] == "#16191d" and "image{filter:" in rules
    used = set(re.findall(r"(?:fill|stroke): (#[0-9a-f]{6})", shapes)) - {style.FLOOR}
    assert len(used) > 10
    for colour in used:
        assert contrast(rgb(changed.get(colour, colour)), rgb("#16191d")) >= 4.5, colour


def test_a_movie_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(AcrcError) as caught:
        run_movie.check(tmp_path / "run.mp4")
    assert str(caught.value) == (
        f"--movie {tmp_path / 'run.mp4'}: the program ffmpeg is not installed; install it or write a .gif"
    )
    for wrong in (tmp_path / "run.avi", tmp_path / "nowhere" / "run.gif"):
        with pytest.raises(OptionError, match=r"with the suffix \.gif or \.mp4"):
            run_movie.check(wrong)


def test_ffmpeg_is_given_pictures_of_even_sides(
    evidence: RunData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text(f'#!/bin/sh\necho "$@" >{tmp_path}/words\n/usr/bin/wc -c >{tmp_path}/bytes\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    run_movie.write(evidence, tmp_path / "run.mp4", 500.0)
    wide, high = map(int, re.findall(r"-s (\d+)x(\d+) ", (tmp_path / "words").read_text())[0])
    assert wide % 2 == high % 2 == 0
    pictures = len(list(run_movie.instants(evidence, 500.0)))
    assert int((tmp_path / "bytes").read_text()) == pictures * wide * high * 3
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    with pytest.raises(AcrcError, match="ffmpeg failed: no such codec"):
        run_movie.write(evidence, tmp_path / "run.mp4", 500.0)


@pytest.mark.nightly
def test_the_demonstration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    over_processes = start.demonstrate
    monkeypatch.setattr(
        start, "demonstrate", lambda options: over_processes(msgspec.structs.replace(options, bus="memory"))
    )
    done = acrc("demo", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (out,) = (tmp_path / "runs").iterdir()
    without, adapted, pictures = done.stdout.splitlines()
    assert without == (
        "Without adaptation: 0 of 6 places cleaned in 150 s. The robots block each other in the doorway."
    )
    assert adapted == (
        "With the chapter's adaptation: 6 of 6 places cleaned in 99 s. The blocked robots exchange "
        "destinations by radio; 4 places were reassigned."
    )
    assert pictures == f"Pictures: {out / 'demo.png'}, {out / 'demo.svg'}"
    assert {path.name for path in out.iterdir()} == {"none", "chapter", "demo.png", "demo.svg"}
    with Image.open(out / "demo.png") as image:
        assert image.size[0] > 1000
    again = acrc("demo", "--out", out)
    assert again.returncode == 2
    assert (
        again.stderr == f"acrc: --out: {out / 'none'} already exists and is not empty; choose a new folder\n"
    )
