"""`acrc list`: everything that can be named is there, with a sentence, for people and for programs."""

import json
from pathlib import Path
from typing import Any

import pytest

from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY as ROOT
from actors.radio.radio_model import PRESETS as RADIO
from actors.robot.localisation.parameters import PRESETS as LOCALISATION
from actors.robot.navigation.navigator import NAVIGATION_PRESETS as NAVIGATION
from actors.robot_model import load_model
from command_line.lists import head_comment, preset_summary
from tests.cli.test_cli import acrc


def listed(what: str, cwd: Path = ROOT) -> list[dict[str, Any]]:
    code, out, err = acrc("list", what, "--json", cwd=cwd)
    assert (code, err) == (0, "")
    rows: list[dict[str, Any]] = json.loads(out)
    return rows


def test_every_preset_is_listed_with_what_its_docstring_says() -> None:
    rows = listed("presets")
    known = [("radio", name) for name in RADIO]
    known += [("localisation", name) for name in (*LOCALISATION, "odometry")]
    known += [("navigation", name) for name in NAVIGATION]
    assert [(row["table"], row["name"]) for row in rows] == known
    assert all(10 < len(row["summary"]) < 300 for row in rows), rows
    assert rows[0]["summary"].startswith("a BEE click's chip and power, ")


def test_every_model_is_listed_with_its_sensors() -> None:
    for row in listed("models"):
        assert row["summary"].endswith(".")
        assert [one["default"] for one in row["sensors"]].count(True) == 1
        for one in row["sensors"]:
            sensor = load_model(row["name"], one["name"]).sensor
            assert (one["rays"], one["range_max"], one["rate"]) == (
                sensor.rays,
                sensor.range_max,
                sensor.rate,
            )


def test_scenarios_and_maps_are_listed_as_they_are_found_from_here(tmp_path: Path) -> None:
    scenarios, maps = listed("scenarios", tmp_path), listed("maps", tmp_path)
    assert {row["name"] for row in scenarios} == {path.stem for path in (ROOT / "scenarios").glob("*.toml")}
    assert all(row["summary"].endswith(".") for row in scenarios)
    assert {row["name"] for row in maps} == {path.stem for path in (ROOT / "maps").glob("*.yaml")}
    for row in (*scenarios, *maps):
        assert (tmp_path / row["path"]).is_file()
    for row in maps:
        grid = load_map(tmp_path / row["path"])
        assert (row["width"], row["depth"]) == (
            grid.columns * grid.resolution, grid.rows * grid.resolution
        )  # fmt: skip


@pytest.mark.parametrize("what", ["strategies", "presets", "models", "scenarios", "maps"])
def test_a_table_for_people_has_a_line_for_each(what: str) -> None:
    code, out, err = acrc("list", what)
    assert (code, err) == (0, "")
    for row in listed(what):
        assert row["name"] in out


def test_what_a_comment_or_a_docstring_says() -> None:
    assert head_comment("# One (2016, a.b). Two.\n\nmap = 1\n# Three.") == "One (2016, a.b)."
    assert head_comment("# One\n# and more.\nmap = 1") == "One and more."
    assert head_comment("map = 1") == ""
    doc = "`a`, the default: one (x: y), two. More. `b`: three; four."
    assert (
        preset_summary("a", doc) == "one, two"
        and preset_summary("b", doc) == "three"
        and preset_summary("c", doc) == ""
    )
