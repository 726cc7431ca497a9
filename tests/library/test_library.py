"""Examples of docs/library.md run, errors are sentences, and the import is light."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import acrc_testbed as acrc
from acrc_testbed.argument_names import arguments_named
from actors.installation.repository import REPOSITORY, SHIPPED
from actors.installation.usage import OptionError
from tests import in_process
from tests.documentation.markdown import MarkdownPage

PAGE = MarkdownPage(REPOSITORY / "docs" / "library.md")
FINDINGS = """
import json, sys
import numpy as np
told = {
    "digests": [without.result.digest, adapted.result.digest],
    "isolation": adapted.result.isolation,
    "places": [one.result.task["places_done"] for one in (without, adapted)],
    "tables": {name: table.num_rows for name, table in tables.items()},
    "shape": run.data.true.shape,
    "robots": sorted(run.time_spent().robots),
    "rows": campaign.results().num_rows,
    "again": acrc.open_campaign("campaigns/mine").compare("places")[0].effect.value == places.effect.value,
}
sys.stderr.write(json.dumps(told))
"""


SHORT = (("duration=60", "duration=20"), ('"run.duration" = 20', '"run.duration" = 5'))
"""Replacements in the page that shorten its runs."""


@pytest.mark.nightly
@pytest.mark.timeout(300)
def test_examples_of_the_page_run(tmp_path: Path) -> None:
    """Run all blocks of the page in one program, as in a notebook."""
    folder = tmp_path
    for name in ("scenarios", "maps"):
        (folder / name).symlink_to(REPOSITORY / name)
    blocks = list(PAGE.blocks())
    (study,) = (block.text for block in blocks if block.language == "toml")
    program = "\n".join(block.text for block in blocks if block.language == "python")
    for page, day in SHORT:
        assert page in program + study
        program, study = program.replace(page, day), study.replace(page, day)
    program += FINDINGS
    seconds = int(re.findall(r"duration=(\d+)", program)[0])
    (folder / "my_study.toml").write_text(study)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (folder / "adapted.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (folder / "both.svg").read_text()
    assert done.stdout.endswith("nowhere: does not exist\n")
    told = json.loads(done.stderr.splitlines()[-1])
    assert (told["robots"], told["rows"], told["again"]) == (["r1", "r2"], 12, True)
    assert told["shape"] == [10 * seconds, 2, 3]
    assert (told["tables"]["poses"], told["tables"]["places"]) == (20 * seconds, 6)


def test_a_run_is_that_of_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    made = acrc.run("head_on", seed=3, duration=2, bus="memory")
    scenario = REPOSITORY / "scenarios" / "head_on.toml"
    words = ("run", scenario, "--seed", 3, "--duration", 2, "--bus", "memory", "--out", "command", "--json")
    done = in_process.acrc(*words, cwd=tmp_path)
    assert made.result is not None and json.loads(done.stdout)["digest"] == made.result.digest
    assert made.data.true.shape == (20, 2, 3) and sorted(made.time_spent().robots) == ["r1", "r2"]


def test_a_run_in_memory_with_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    wished = {"deeco.publish": 0.5, "run.strategy": "none"}
    made = acrc.run("head_on", seed=2, duration=2, settings=wished, bus="memory")
    assert made.folder.parent == tmp_path / "runs"
    assert made.result is not None
    assert made.result.origin.strategy == "none"
    assert made.result.isolation == "none"


def test_errors_are_sentences(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("raise SystemExit('it has run')")
    mine = r"head_on.toml: strategy mine:behaviour: its code .*mine.py .* add modules=\["
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: acrc.run("nowhere"), "nowhere: the scenario file cannot be read: No such file or directory"),
        (lambda: acrc.run("head_on", bus="air"), "bus: air; must be zenoh or memory"),  # type: ignore[arg-type]
        (lambda: acrc.run("head_on", settings={"run.strategy": "mine:behaviour"}), mine),
        (lambda: acrc.open_campaign(tmp_path), f"^{tmp_path}: not a campaign; give a folder"),
    ]
    for call, sentence in wrong:
        with pytest.raises(acrc.AcrcError, match=sentence):
            call()
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("sentence", "right"),
    [
        ("--seed: x; must be a whole number", "seed: x; must be a whole number"),
        ("--set deeco.publish: x; must be above 0", 'settings["deeco.publish"]: x; must be above 0'),
        ("say --modules '/my code', or --trust", 'say modules=["/my code"], or trust=True'),
        ("runs with `--bus memory` and two robots", 'runs with `bus="memory"` and two robots'),
        ("raise the limit with --limit disk_mb=N", "raise the limit with acrc run --limit disk_mb=N"),
        ("use `acrc run --debug r1`", "use `acrc run --debug r1`"),
    ],
)  # fmt: skip
def test_errors_name_arguments(sentence: str, right: str) -> None:
    with pytest.raises(acrc.AcrcError) as caught, arguments_named():
        raise OptionError(sentence)
    assert str(caught.value) == right


OWN = "from cleaning.strategies.none import behaviour as behaviour\n"


def test_only_a_run_is_overwritten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(acrc.AcrcError) as caught:
        acrc.run("head_on", "mine", duration=1, bus="memory", overwrite=True)
    there = tmp_path / "mine"
    assert str(caught.value) == (
        f"out: {there} has no world/world.mcap and is not replaced; choose a new folder"
    )
    acrc.run("head_on", "runs/a", duration=1, bus="memory", overwrite=True)
    with pytest.raises(acrc.AcrcError, match=r"out: .* is not empty; choose a new folder"):
        acrc.run("head_on", "runs/a", duration=1, bus="memory")
    (tmp_path / "runs" / "a" / "run.png").touch()
    with pytest.raises(acrc.AcrcError, match=r'settings\["strategy.reach"\]|strategy.reach'):
        acrc.run("head_on", "runs/a", settings={"strategy.reach": -1}, bus="memory", overwrite=True)
    assert (tmp_path / "runs" / "a" / "run.png").exists()
    again = acrc.run("head_on", "runs/a", seed=9, duration=2, bus="memory", overwrite=True)
    assert again.result is not None and again.result.simulated_s == 2
    assert not (tmp_path / "runs" / "a" / "run.png").exists()
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["a"]


def test_a_campaign_is_overwritten_on_request(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acrc_testbed.experiments.campaign.run_campaign", lambda kept, options: None)
    text = f'scenario = "{SHIPPED}/scenarios/head_on.toml"\nstrategies = ["none", "chapter"]\nseeds = 6\n'
    (tmp_path / "s.toml").write_text(text)
    folder = acrc.campaign(tmp_path / "s.toml", tmp_path / "c").folder
    with pytest.raises(acrc.AcrcError, match="the campaign has 6 seeds; 2 must not be fewer"):
        acrc.campaign(tmp_path / "s.toml", folder, seeds=2)
    again = acrc.campaign(tmp_path / "s.toml", folder, seeds=2, overwrite=True)
    assert len(again.results()) == 0 and again._store().study.seeds == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c", "s.toml"]
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "text.tex").touch()
    with pytest.raises(acrc.AcrcError, match=r"out: .* has no study.json and is not replaced"):
        acrc.campaign(tmp_path / "s.toml", tmp_path / "thesis", overwrite=True)


def test_the_import_is_light() -> None:
    program = (
        "import sys, acrc_testbed; print([n for n in ('numpy', 'matplotlib', 'rich') if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
