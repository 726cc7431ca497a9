"""The main workflow: record a run, view it, replay it, compare strategies."""

import json
from pathlib import Path
from typing import Any

import pytest

from actors.installation.repository import REPOSITORY as ROOT
from tests.in_process import acrc


class Shell:
    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def type(self, words: str, makes: str = "") -> str:
        """Return standard output of a command that must succeed and write the file `makes`."""
        done = acrc(*words.split(), cwd=self.folder)
        assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
        assert not makes or (self.folder / makes).stat().st_size > 0, f"{words}: {makes} is missing"
        return done.stdout

    def answer(self, words: str, makes: str = "") -> Any:
        return json.loads(self.type(f"{words} --json", makes))


@pytest.mark.timeout(300)
@pytest.mark.usefixtures("forked_servers")
def test_record_look_replay_and_compare(tmp_path: Path) -> None:
    for name in ("scenarios", "maps"):
        (tmp_path / name).symlink_to(ROOT / name)
    shell = Shell(tmp_path)
    run = "run scenarios/head_on.toml --seed 3 --bus memory --duration 5 --strategy none --out runs/a"
    digest = shell.answer(run, "runs/a/run.json")["digest"]
    assert shell.answer("record check runs/a")["digest"] == digest
    shell.type("view runs/a --png", "runs/a/run.png")
    assert f"digest {digest}" in shell.type("replay runs/a")
    assert shell.answer("replay runs/a --robot r1")["whole"] is True
    tables = shell.answer("export runs/a --out tables", "tables/poses.parquet")
    assert {"places", "poses"} <= {Path(one["file"]).stem for one in tables}
    assert "r2" in shell.type("causes runs/a --json")
    assert shell.answer("record info runs/a r1/drive --from 1 --to 2")
    assert (
        shell.type("record echo runs/a r1/drive --csv --from 4")
        .splitlines()[1]
        .startswith("4.0,r1/drive,40,")
    )
    campaign = (
        "campaign --scenario scenarios/head_on.toml --strategies none,chapter --seeds 2 --duration 1 "
        "--check-every 0 --jobs 1 --out campaigns/a"
    )
    shell.type(campaign, "campaigns/a/results.csv")
    assert "none" in shell.type("compare campaigns/a --metric radio")
    page = shell.answer("report campaigns/a --out page", "page/report.html")["page"]
    assert "chapter" in (tmp_path / page).read_text()
