"""Pictures have what they are for, look the same every time, and are made by commands."""

import io
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest
from PIL import Image

from actors.installation.usage import OptionError
from actors.observer.glyphs import MARKS, SEEN_STATES, contrast, hexadecimal
from actors.runtime.errors import AcrcError
from command_line import look as look_commands
from deploy.run import demonstration
from observation.evidence.run_evidence import RunEvidence
from observation.picture import floor_picture, moving, run_html, run_page, side_by_side, style
from tests.in_process import acrc
from tests.recorded_runs import record

if TYPE_CHECKING:
    from tests.control.browser import Browser


def colours(path: Path) -> set[tuple[int, int, int]]:
    with Image.open(path) as image:
        return set(map(tuple, np.asarray(image.convert("RGB")).reshape(-1, 3).tolist()))


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def test_a_page_shows_floor_robots_and_what_they_did(evidence: RunEvidence, tmp_path: Path) -> None:
    run_page.write(evidence, tmp_path / "run.png")
    seen = colours(tmp_path / "run.png")
    wanted = [
        style.WALL,
        style.UNKNOWN,
        style.colour(0),
        style.colour(1),
        *(hexadecimal(glyph.colour) for glyph in SEEN_STATES.values()),
    ]
    shown = [colour for colour in wanted if rgb(colour) in seen]
    assert len(shown) >= 8, "walls, both robots, and the kinds of spells that there are"


def test_a_page_says_what_run_it_is(evidence: RunEvidence) -> None:
    figure = run_page.draw(evidence)
    assert figure.axes[0].get_title(loc="left") == (
        f"chapter: 6 of 6 places in 99.1 s   (2 robots, seed 1, digest {evidence.result.digest[:8]})"  # type: ignore[union-attr]
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
    assert all(axes.get_title(loc="left") == "chapter: 6 of 6 places in 99.1 s" for axes in floors)
    low, high = floors[0].get_xlim()
    assert low <= evidence.true[..., 0].min() and evidence.true[..., 0].max() <= high


def test_robots_beyond_the_palette_have_a_colour_too() -> None:
    assert style.colour(len(style.ROBOTS)) == style.colour(0)
    assert not style.few([f"r{n}" for n in range(13)])
    assert len({mark.get_label() for mark in floor_picture.legend(MARKS)}) == len(MARKS)


def test_view_draws_beside_the_run(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "copy"
    shutil.copytree(folder, out)
    done = acrc("view", out, "--png", "--svg", "--html", "--movie", tmp_path / "m.gif", "--speed", 200)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        *(str(out / f"run.{kind}") for kind in ("png", "svg", "html")), str(tmp_path / "m.gif")
    ]  # fmt: skip
    assert (out / "run.svg").read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("words", "folder", "files"),
    [
        ("runs/a", "runs/a", {}),
        ("runs/a page.html", "runs/a", {".html": "page.html"}),
        ("x.svg", None, {".svg": "x.svg"}),
        ("x.png runs/a y.html", "runs/a", {".png": "x.png", ".html": "y.html"}),
    ],
)
def test_pages_go_to_files_that_are_named(words: str, folder: str | None, files: dict[str, str]) -> None:
    found = look_commands._folder_and_files([Path(word) for word in words.split()])
    assert found == (folder and Path(folder), {suffix: Path(file) for suffix, file in files.items()})


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("runs/a page.jpg", "view: has no use for page.jpg; must be as in .* view runs/a --html page.html"),
        ("runs/a nowhere/a.png", "--png: nowhere/a.png; must be a file in a folder that exists"),
    ],
)
def test_a_file_that_cannot_be_a_page_is_one_sentence(words: str, sentence: str) -> None:
    with pytest.raises(OptionError, match=sentence):
        look_commands._folder_and_files([Path(word) for word in words.split()])


def test_a_run_too_short_to_judge_is_drawn_with_a_warning(tmp_path: Path) -> None:
    out = tmp_path / "short"
    record(out, duration=2.0)
    warning = f"acrc: {out}: the run lasts 2 s; nothing can be judged from less than 5 s\n"
    for words in (("--png",), ("--beside", out, "--svg")):
        done = acrc("view", out, *words)
        assert (done.returncode, done.stderr) == (0, warning * (1 + ("--beside" in words)))


def test_runs_are_drawn_beside_one_another(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "copy"
    shutil.copytree(folder, out)
    done = acrc("view", out, "--beside", folder, "--svg")
    assert (done.returncode, done.stdout) == (0, f"{out / 'beside.svg'}\n"), done.stderr
    page = acrc("view", out, "--beside", folder, "--html")
    assert page.returncode == 2
    assert page.stderr == "acrc: --beside: cannot be combined with --html, --movie or --why\n"


def test_a_page_needs_nothing_beside_itself_and_says_what_the_run_said(
    evidence: RunEvidence, tmp_path: Path
) -> None:
    run_html.write(evidence, tmp_path / "run.html")
    page = (tmp_path / "run.html").read_text()
    assert page.startswith("<!DOCTYPE html>") and page.count("data:image/svg+xml;base64,") == 1
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", page) and "<script" not in page
    cleaned = "2 robots with strategy chapter and navigation chapter cleaned all 6 places in 99 simulated s."
    assert f"<p>{cleaned}</p>" in page
    headings = re.findall(r"<h2 id=\"s(\d)\">", page)
    assert headings == [str(number) for number in range(1, len(headings) + 1)] and len(headings) == 8
    assert page.count("<td>takes over ") == len(evidence.taken_over)
    assert "<td>r2/0</td>" in page and str(evidence.out) not in page


def test_what_robots_are_called_does_no_harm_to_a_page(evidence: RunEvidence) -> None:
    assert evidence.result is not None
    origin = msgspec.structs.replace(evidence.result.origin, strategy="<script>alert(1)</script>")
    result = msgspec.structs.replace(evidence.result, origin=origin)
    page = run_html.html(replace(evidence, result=result), b"")
    assert "<script" not in page and "&lt;script&gt;alert(1)" in page


def test_what_has_no_result_was_cut_off_or_goes_on(
    evidence: RunEvidence, folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "cut"
    shutil.copytree(folder, out, ignore=shutil.ignore_patterns("run.json"))
    cut = replace(evidence, out=out, result=None)
    page = run_html.html(cut, b"")
    assert "<p>The run was cut off; this is what was recorded in its first 99.1 simulated s.</p>" in page
    assert "How to make it again</h2>" not in page
    assert style.title(cut) == "2 robots, seed 1: cut off after 99.1 s"
    world = next((out / "world").glob("*.mcap"))
    world.write_bytes(world.read_bytes()[:-1000])
    with world.open("ab") as file:
        writer = subprocess.Popen(["sleep", "60"], stdout=file)
    try:
        drawn = acrc("view", out, "--png", "--html")
        assert style.title(cut) == "2 robots, seed 1: up to 99.1 s: it is going on"
    finally:
        writer.kill()
        writer.wait()
    told = re.fullmatch(
        r"the run is going on: it is drawn as far as it was recorded, up to ([\d.]+) s\n", drawn.stderr
    )
    assert told is not None, drawn.stderr
    page = (out / "run.html").read_text()
    assert f"<h1>up to {told[1]} s: it is going on</h1>" in page
    said = f"<p>The run is going on; this is what was recorded in its first {told[1]} simulated s.</p>"
    assert said in page and "cut off" not in page
    assert acrc("view", out, "--png").stderr.startswith("the run has died without a result: it is drawn as ")


def test_on_a_dark_screen_a_page_and_its_picture_are_dark(
    evidence: RunEvidence, browser: "Browser", tmp_path: Path
) -> None:
    run_html.write(evidence, tmp_path / "run.html")
    bright = {}
    for scheme in ("light", "dark"):
        browser.open((tmp_path / "run.html").as_uri(), scheme=scheme)
        browser.value("document.images[0].scrollIntoView()")
        with Image.open(io.BytesIO(browser.shot())) as image:
            bright[scheme] = float((np.asarray(image.convert("L")) > 127).mean())
    assert bright["light"] > 0.8 and bright["dark"] < 0.2, bright


def test_what_is_drawn_for_a_dark_screen_can_be_seen_there(evidence: RunEvidence) -> None:
    with style.applied(style.LOOK):
        drawn = style.svg(run_page.draw(evidence)).decode()
    rules, shapes = drawn.split("@media (prefers-color-scheme: dark){")[1].split("</style>", 1)
    changed = dict(re.findall(r"fill: (#[0-9a-f]{6})\"\]\{fill:(#[0-9a-f]{6})", rules))
    assert changed[style.FLOOR] == "#16191d" and "image{filter:" in rules
    used = set(re.findall(r"(?:fill|stroke): (#[0-9a-f]{6})", shapes)) - {style.FLOOR}
    assert len(used) > 10
    for colour in used:
        assert contrast(rgb(changed.get(colour, colour)), rgb("#16191d")) >= 4.5, colour


def test_a_movie_shows_robots_moving_and_places_filling(evidence: RunEvidence, tmp_path: Path) -> None:
    path = tmp_path / "run.gif"
    moving.write(evidence, path, 100.0)
    shown = list(moving.instants(evidence, 100.0))
    with Image.open(path) as movie:
        assert getattr(movie, "n_frames", 0) == len(shown) == 11 and movie.info["duration"] == 100
        frames = []
        for number in (0, len(shown) - 1):
            movie.seek(number)
            frames.append(np.asarray(movie.convert("RGB")).astype(int))
    assert shown[-1] == len(evidence.seconds) - 1
    assert (np.abs(frames[1] - frames[0]).sum(axis=2) > 100).sum() > 200


def test_a_movie_that_cannot_be_written_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(AcrcError) as caught:
        moving.check(tmp_path / "run.mp4")
    assert str(caught.value) == (
        f"--movie {tmp_path / 'run.mp4'}: needs the program ffmpeg, which is not here; a .gif needs nothing"
    )
    for wrong in (tmp_path / "run.avi", tmp_path / "nowhere" / "run.gif"):
        with pytest.raises(OptionError, match=r"its name ending in \.gif or \.mp4"):
            moving.check(wrong)


def test_ffmpeg_is_given_pictures_of_even_sides(
    evidence: RunEvidence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text(f'#!/bin/sh\necho "$@" >{tmp_path}/words\n/usr/bin/wc -c >{tmp_path}/bytes\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    moving.write(evidence, tmp_path / "run.mp4", 500.0)
    wide, high = map(int, re.findall(r"-s (\d+)x(\d+) ", (tmp_path / "words").read_text())[0])
    assert wide % 2 == high % 2 == 0
    pictures = len(list(moving.instants(evidence, 500.0)))
    assert int((tmp_path / "bytes").read_text()) == pictures * wide * high * 3
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    with pytest.raises(AcrcError, match="ffmpeg says no such codec"):
        moving.write(evidence, tmp_path / "run.mp4", 500.0)


def test_the_demonstration_shows_the_problem_and_its_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    over_processes = demonstration.demonstrate
    monkeypatch.setattr(
        demonstration, "demonstrate", lambda options: over_processes(replace(options, bus="memory"))
    )
    done = acrc("demo", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    (out,) = (tmp_path / "runs").iterdir()
    without, adapted, pictures = done.stdout.splitlines()
    assert without == (
        "Without adaptation: 0 of 6 places are clean by 150 s. One robot wants out of the office, one wants "
        "in, and neither gives way."
    )
    assert adapted == (
        "With the chapter's adaptation: 6 of 6 places are clean by 99.1 s. Who is blocked tells the other by "
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
