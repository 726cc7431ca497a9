"""What is printed stays what it is: no name is broken in narrow terminals, nothing in it means a picture."""

import json
import re
import subprocess
from pathlib import Path

import pytest
from rich.table import Table

from actors.console import print_table, screen
from actors.installation.repository import REPOSITORY
from cleaning.strategies.registry import STRATEGIES
from command_line.documentation import tree
from command_line.options import answer
from tests.in_process import acrc

NAMES = ("none-giving-up", "chapter-careful", "my_package.strategies:make_way", "r1", "of 12 places")
TEXT = "Visit the own places in their order, whatever others do, or [bold] :x: happens."


def made() -> Table:
    table = Table("strategy", "what it does", "places done", title="All :x:")
    for name in NAMES:
        table.add_row(name, TEXT, "12.5 [11.0, 14.0]")
    return table


@pytest.mark.parametrize("width", [20, 34, 60, 70, 80, 100, 200])
def test_a_table_breaks_no_word_at_any_width(width: int, capsys: pytest.CaptureFixture[str]) -> None:
    print_table(screen(width=width), made())
    told = capsys.readouterr().out
    words = {word for text in (*NAMES, TEXT, "12.5 [11.0, 14.0]") for word in text.split()}
    assert words <= set(re.split(r"[\s│┃]+", told))
    assert ("┃" in told) == (width >= 60), "a table where it fits, rows where it does not"
    assert width < 60 or max(map(len, told.splitlines())) <= width


def test_a_table_that_does_not_fit_is_told_row_by_row(capsys: pytest.CaptureFixture[str]) -> None:
    table = Table("name", "", "entry", title="Two")
    table.add_row("none", "", "cleaning.strategies.none:behaviour")
    table.add_row("mine", "of\nmine", "")
    print_table(screen(width=20), table)
    assert capsys.readouterr().out.splitlines() == [
        "Two",
        "none",
        "  entry: cleaning.strategies.none:behaviour",
        "mine",
        "  of",
        "    mine",
    ]


@pytest.mark.parametrize("columns", ["40", "60", "80"])
def test_a_narrow_terminal_breaks_no_strategys_name(columns: str) -> None:
    done = acrc("list", "strategies", env={"COLUMNS": columns})
    assert done.returncode == 0, done.stderr
    shown = done.stdout.split()
    entries = [entry for entry in STRATEGIES.values() if entry not in shown]
    assert entries == [] and set(STRATEGIES) <= set(shown)


def test_colons_and_brackets_in_a_name_stay_what_they_are(tmp_path: Path) -> None:
    done = acrc("view", "a:x:[b]", cwd=tmp_path)
    assert done.stderr == "acrc: a:x:[b]: no run's folder: there is no */*.mcap in it\n"


def test_there_is_one_kind_of_console() -> None:
    listed = subprocess.run(
        ["git", "grep", "-lE", r"\bConsole\(", "--", "*.py", ":!tests/"],
        cwd=REPOSITORY, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert listed.stdout.split() == ["actors/console.py"]


def test_every_command_that_answers_does_so_in_json_too() -> None:
    commands = {words: command for words, command in tree().items() if not hasattr(command, "list_commands")}
    without = {
        words
        for words, command in commands.items()
        if not any("--json" in one.opts for one in command.params)
    }
    assert without == {
        *("acrc add", "acrc check", "acrc docs", "acrc test", "acrc fleet onboard", "acrc fleet watch"),
        *("acrc cluster start", "acrc cluster join"),
    }, "what only does something, or goes on until it is ended"  # fmt: skip


def test_json_is_alone_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    told = {"file": Path("runs/a:x:"), "rows": 3}
    answer(["one :x:", "two"], told, json=False)
    assert capsys.readouterr().out == "one :x:\ntwo\n"
    answer(["one :x:", "two"], told, json=True)
    assert json.loads(capsys.readouterr().out) == {"file": "runs/a:x:", "rows": 3}
    assert json.loads(acrc("scenario", "scenarios/head_on.toml", "--json").stdout)["robots"] == 2
    assert json.loads(acrc("scenario", "maps/corridor.yaml", "--json").stdout)["narrow_places"] == 5
