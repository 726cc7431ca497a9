"""The library does what docs/library.md shows, its errors are sentences, and its import is light."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import acrc_testbed as acrc
from actors.installation.repository import REPOSITORY, SHIPPED
from command_line.documentation.markdown import MarkdownPage
from tests import warm

PAGE = MarkdownPage(REPOSITORY / "docs" / "library.md")
FINDINGS = """
import json, sys
import numpy as np
told = {
    "digests": [without.result.digest, adapted.result.digest],
    "isolation": adapted.result.isolation,
    "places": [without.result.places_done, adapted.result.places_done],
    "tables": {name: table.num_rows for name, table in tables.items()},
    "shape": run.evidence.true.shape,
    "robots": sorted(run.time_spent().robots),
    "rows": campaign.results().num_rows,
    "again": acrc.open_campaign("campaigns/mine").compare("places")[0].effect.value == places.effect.value,
}
sys.stderr.write(json.dumps(told))
"""


SHORT = (("duration=60", "duration=20"), ('"run.duration" = 20', '"run.duration" = 5'))
"""What the page has, and what it has by day."""


@pytest.fixture(scope="module", params=[SHORT, pytest.param((), marks=pytest.mark.nightly)])
def told(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> dict[str, object]:
    """What the blocks of the page have come to, one after the other in one program, as in a notebook."""
    folder = tmp_path_factory.mktemp("notebook")
    (folder / "scenarios").symlink_to(REPOSITORY / "scenarios")
    (folder / "maps").symlink_to(REPOSITORY / "maps")
    blocks = list(PAGE.blocks())
    (study,) = (block.text for block in blocks if block.language == "toml")
    program = "\n".join(block.text for block in blocks if block.language == "python")
    for page, day in request.param:
        assert page in program + study
        program, study = program.replace(page, day), study.replace(page, day)
    program += FINDINGS
    seconds = re.findall(r"duration=(\d+)", program)[0]
    (folder / "my_study.toml").write_text(study)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (folder / "adapted.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (folder / "both.svg").read_text()
    assert done.stdout.endswith("nowhere: no run's folder: there is no */*.mcap in it\n")
    found: dict[str, object] = json.loads(done.stderr.splitlines()[-1])
    return found | {"seconds": int(seconds)}


def test_the_page_does_what_it_shows(told: dict[str, object]) -> None:
    assert told["robots"] == ["r1", "r2"]
    seconds = told["seconds"]
    assert isinstance(seconds, int)
    assert told["shape"] == [10 * seconds, 2, 3]
    assert told["rows"] == 12
    assert told["again"] is True
    tables = told["tables"]
    assert isinstance(tables, dict)
    assert (tables["poses"], tables["places"]) == (20 * seconds, 6)


def test_a_run_is_that_of_the_command_line(told: dict[str, object], tmp_path: Path) -> None:
    words = (
        "run",
        str(REPOSITORY / "scenarios" / "head_on.toml"),
        "--seed",
        "3",
        "--duration",
        str(told["seconds"]),
        "--json",
    )
    done = warm.run((*words, "--bus", "memory"), tmp_path, os.environ, 100.0, finds_cwd=False)
    assert isinstance(told["digests"], list)
    assert json.loads(done.stdout)["digest"] == told["digests"][1]


def test_in_memory_with_settings_and_places_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    with pytest.raises(acrc.AcrcError) as caught:
        acrc.run("nowhere")
    assert str(caught.value) == "nowhere: the scenario file cannot be read: No such file or directory"
    with pytest.raises(acrc.AcrcError) as caught:
        acrc.run("head_on", bus="air")  # type: ignore[arg-type]
    assert str(caught.value) == "--bus: air; must be zenoh or memory"
    with pytest.raises(acrc.AcrcError) as caught:
        acrc.run("head_on", settings={"run.strategy": "mine:behaviour"})
    assert str(caught.value) == (
        f"{SHIPPED / 'scenarios' / 'head_on.toml'} names the strategy mine:behaviour, whose code "
        f"{tmp_path / 'mine.py'} is neither installed nor in a folder that you have named; read it, then say "
        "--modules ., or --trust"
    )
    with pytest.raises(acrc.AcrcError) as caught:
        acrc.open_campaign(tmp_path)
    assert str(caught.value) == f"{tmp_path}: holds no campaign; must be a folder that acrc campaign has made"
    assert not (tmp_path / "runs").exists()


def test_the_import_is_light() -> None:
    program = (
        "import sys, acrc_testbed; print([n for n in ('numpy', 'matplotlib', 'rich') if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
