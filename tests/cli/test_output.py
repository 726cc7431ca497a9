"""Output of commands: lists, tables, JSON and completion, at any terminal width."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from rich.table import Table

from acrc_testbed.command_line.documentation import command_tree
from acrc_testbed.command_line.lists import head_comment, preset_summary
from acrc_testbed.command_line.shared_options import answer
from actors.console import create_console, print_table
from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY as ROOT
from actors.radio.radio_model import PRESETS as RADIO
from actors.robot.localisation.parameters import PRESETS as LOCALISATION
from actors.robot.navigation.navigator import NAVIGATION_PRESETS as NAVIGATION
from actors.robot_model import load_model
from cleaning.strategies.registry import STRATEGIES
from deploy.run.order_bus import VERBS
from tests.in_process import acrc

NAMES = ("none-giving-up", "chapter-careful", "my_package.strategies:make_way", "r1", "of 12 places")
TEXT = "Visit the own places in their order, whatever others do, or [bold] :x: happens."


def listed(what: str, cwd: Path = ROOT) -> list[dict[str, Any]]:
    done = acrc("list", what, "--json", cwd=cwd)
    assert (done.returncode, done.stderr) == (0, "")
    rows: list[dict[str, Any]] = json.loads(done.stdout)
    return rows


def test_every_preset_is_listed_with_its_summary() -> None:
    rows = listed("presets")
    known = [("radio", name) for name in RADIO]
    known += [("localisation", name) for name in (*LOCALISATION, "odometry")]
    known += [("navigation", name) for name in NAVIGATION]
    assert [(row["table"], row["name"]) for row in rows] == known
    assert all(10 < len(row["summary"]) < 300 for row in rows), rows
    assert rows[0]["summary"].startswith("chip and power of a BEE click, ")


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


def test_summaries_of_comments_and_docstrings() -> None:
    assert head_comment("# One (2016, a.b). Two.\n\nmap = 1\n# Three.") == "One (2016, a.b)."
    assert head_comment("# One\n# and more.\nmap = 1") == "One and more."
    assert head_comment("map = 1") == ""
    doc = "`a`, the default: one (x: y), two. More. `b`: three; four."
    assert (
        preset_summary("a", doc) == "one, two"
        and preset_summary("b", doc) == "three"
        and preset_summary("c", doc) == ""
    )


@pytest.mark.parametrize("width", [20, 34, 60, 80, 200])
def test_a_table_breaks_no_word_at_any_width(width: int, capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("strategy", "what it does", "places done", title="All :x:")
    for name in NAMES:
        table.add_row(name, TEXT, "12.5 [11.0, 14.0]")
    print_table(create_console(width=width), table)
    told = capsys.readouterr().out
    words = {word for text in (*NAMES, TEXT, "12.5 [11.0, 14.0]") for word in text.split()}
    assert words <= set(re.split(r"[\s│┃]+", told))
    assert ("┃" in told) == (width >= 60), "a table where it fits, rows where it does not"
    assert width < 60 or max(map(len, told.splitlines())) <= width


def test_a_table_that_does_not_fit_is_printed_row_by_row(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("name", "", "entry", title="Two")
    table.add_row("none", "", "cleaning.strategies.none:behaviour")
    table.add_row("mine", "of\nmine", "")
    print_table(create_console(width=20), table)
    assert capsys.readouterr().out.splitlines() == [
        "Two",
        "none",
        "  entry: cleaning.strategies.none:behaviour",
        "mine",
        "  of",
        "    mine",
    ]


@pytest.mark.parametrize("columns", ["40", "80"])
def test_lists_break_no_name(columns: str) -> None:
    for what in ("strategies", "presets", "models", "scenarios", "maps"):
        done = acrc("list", what, env={"COLUMNS": columns})
        assert (done.returncode, done.stderr) == (0, "")
        assert all(row["name"] in done.stdout for row in listed(what))
    shown = set(acrc("list", "strategies", env={"COLUMNS": columns}).stdout.split())
    assert {*STRATEGIES, *STRATEGIES.values()} <= shown


def test_colons_and_brackets_in_a_name_are_printed_as_they_are(tmp_path: Path) -> None:
    done = acrc("view", "a:x:[b]", "--png", cwd=tmp_path)
    assert done.stderr == "acrc: a:x:[b]: does not exist\n"


def test_there_is_one_kind_of_console() -> None:
    listed = subprocess.run(
        ["git", "grep", "-lE", r"\bConsole\(", "--", "*.py", ":!tests/"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert listed.stdout.split() == ["actors/console.py"]


def test_every_command_with_output_offers_json() -> None:
    commands = {
        words: command for words, command in command_tree().items() if not hasattr(command, "list_commands")
    }
    without = {
        words
        for words, command in commands.items()
        if not any("--json" in one.opts for one in command.params)
    }
    assert without == {
        *("acrc add", "acrc check", "acrc docs", "acrc test", "acrc fleet onboard", "acrc fleet watch"),
        *("acrc cluster start", "acrc cluster join"),
    }, "commands without output, or that run until they are stopped"  # fmt: skip


def test_json_is_alone_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    data = {"file": Path("runs/a:x:"), "rows": 3}
    answer(["one :x:", "two"], data, json=False)
    assert capsys.readouterr().out == "one :x:\ntwo\n"
    answer(["one :x:", "two"], data, json=True)
    assert json.loads(capsys.readouterr().out) == {"file": "runs/a:x:", "rows": 3}
    assert json.loads(acrc("scenario", "scenarios/head_on.toml", "--json").stdout)["robots"] == 2
    assert json.loads(acrc("scenario", "maps/corridor.yaml", "--json").stdout)["narrow_places"] == 5


def told(words: str, cwd: Path = ROOT) -> list[str]:
    asked = {"_ACRC_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    done = acrc(cwd=cwd, env=asked)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def test_commands_and_options() -> None:
    assert told("acrc r") == ["run", "replay", "record", "report"]
    assert told("acrc fleet st") == ["stop"]
    assert "--timeout" in told("acrc run --t")


def test_scenarios_are_the_shipped_ones_and_those_of_the_folder(tmp_path: Path) -> None:
    shipped = [
        f"scenarios/{name}.toml"
        for name in ("chapter", "corridor", "head_on", "logistics", "people", "warehouse")
    ]
    assert told("acrc run sc") == shipped
    (tmp_path / "mine.toml").touch()
    offered = told("acrc run ", tmp_path)
    assert offered[0] == "mine.toml"
    assert [(tmp_path / name).resolve() for name in offered[1:]] == [ROOT / name for name in shipped]
    assert told("acrc run nothing/like/it") == [], "the shell completes files then"


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("acrc run --strategy ", list(STRATEGIES)),
        ("acrc run --strategy chapter-m", ["chapter-mute"]),
        ("acrc run --bus ", ["zenoh", "memory"]),
        ("acrc run --spawn e", ["exec"]),
        ("acrc order out ", list(VERBS)),
    ],
)
def test_values(words: str, offered: list[str]) -> None:
    assert told(words) == offered


def test_completion_is_installed_for_the_named_shell(tmp_path: Path) -> None:
    env = {"HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = acrc("--install-completion", "bash", env=env)
    assert (done.returncode, done.stderr) == (0, "")
    script = (tmp_path / ".bash_completions" / "acrc.sh").read_text()
    assert "_ACRC_COMPLETE=complete_bash" in script and script.endswith(" acrc")
    assert str(tmp_path) in (tmp_path / ".bashrc").read_text()
