"""The example of docs/deeco.md and the programs with typing mistakes, run and type-checked."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from deeco.ensemble import ensemble_type
from deeco.explain.command import main as explain
from deeco.link import LinkParameters
from deeco.network import NetworkParameters, RelayParameters
from deeco.node import CASCADE_LIMIT

HERE = Path(__file__).parent / "mistakes"
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "deeco.md").read_text()
EXAMPLE, KEY, GROUP, HISTORY, MODES = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
MARK = "# mistake: "
GROUP_ROLES = """
from deeco import *
@role
class Field(GroupCoordinator): ...
@component
class Station(Field): ...
@role
class Drone(GroupMember): ...
@component
class Quadcopter(Drone): ...
@role
class Charger(GroupMember): ...
"""


def lines(name: str) -> list[str]:
    return (HERE / f"{name}.txt").read_text().splitlines()


def test_the_example_prints_the_documented_output_and_can_be_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "page_example.py").write_text(EXAMPLE)
    monkeypatch.syspath_prepend(tmp_path)
    exec(EXAMPLE, {"__name__": "__main__"})
    assert f"\nIt prints:\n\n```text\n{capsys.readouterr().out}```\n" in PAGE
    assert explain(["page_example"]) == 0
    assert "switch, a process of the adaptation layer, on a change of is_needed\n" in capsys.readouterr().out


def test_the_example_of_a_group_is_a_group() -> None:
    names: dict[str, Any] = {}
    exec(GROUP_ROLES + GROUP, names)
    kind = ensemble_type(names["Protection"])
    assert kind is not None and [*kind.members] == ["drones", "charger"]
    assert {*kind.exchanges} == {"priority", "select_drones", "utility_drones", "at_group", "at_member"}


def test_the_example_of_a_history_is_a_role() -> None:
    names: dict[str, Any] = {}
    exec(HISTORY, names)
    room = names["Room"]
    values = tuple((second, 20.0 + second) for second in range(4))
    assert room(id="hall", recent=values).is_rising() and not room(id="hall", recent=values[:2]).is_rising()


def test_the_example_of_a_key_makes_an_authenticator() -> None:
    names: dict[str, Any] = {}
    exec(KEY, names)
    assert names["parameters"].authenticator.tag_size == 8


def test_the_example_of_modes_prints_the_documented_output(capsys: pytest.CaptureFixture[str]) -> None:
    exec(MODES, {"__name__": "__main__"})
    assert f"\nIt prints:\n\n```text\n{capsys.readouterr().out}```\n" in PAGE


def test_the_numbers_of_the_page_are_those_of_the_code() -> None:
    network, relay = NetworkParameters(), RelayParameters()
    for sentence in (
        f"Every {network.publish_every // 1000} ms, first at",
        f"A replica older than {network.forget_after // 1_000_000} s is dropped",
        f"Beyond {network.max_replicas} the oldest is dropped",
        f"After {CASCADE_LIMIT} rounds of triggered changes",
        f"at most {relay.hop_limit} hops far",
        f"at most {LinkParameters().frame_data} bytes in a frame",
    ):
        assert sentence in " ".join(PAGE.split())
    assert network.relay is None


@pytest.mark.nightly
def test_mypy_finds_every_mistake_on_its_line_and_nothing_else(tmp_path: Path) -> None:
    for name in ("mistaken", "corrected"):
        (tmp_path / f"{name}.py").write_text("\n".join(lines(name)) + "\n")
    (tmp_path / "example.py").write_text(EXAMPLE)
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir=cache", "--no-pretty"]
    run = subprocess.run(
        [*command, "mistaken.py", "corrected.py", "example.py"], cwd=tmp_path, env={"MYPYPATH": str(ROOT)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 1, run.stdout + run.stderr
    reported = {
        (place[1], int(place[2]))
        for line in run.stdout.splitlines()
        if (place := re.match(r"(mistaken|corrected|example)\.py:(\d+): error: ", line))
    }
    assert reported == {
        ("mistaken", number) for number, line in enumerate(lines("mistaken"), start=1) if MARK in line
    }


def test_the_corrected_twin_runs_and_differs_in_its_mistakes_only() -> None:
    exec("\n".join(lines("corrected")), {"__name__": "corrected"})
    pairs = zip(lines("mistaken"), lines("corrected"), strict=True)
    differing = [wrong.strip() for wrong, right in pairs if wrong != right]
    marked = [line for line in lines("mistaken") if MARK in line]
    assert sum(MARK in line for line in differing) == len(marked) >= 8
    assert sum(MARK not in line for line in differing) <= 6
