"""`acrc export`: every table, its documented columns, and its numbers as counted by the run itself."""

import json
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from acrc_testbed.export.parquet_files import schema_page, tables_of
from actors.installation.repository import REPOSITORY
from cleaning.task import CleaningTask
from tests.documentation.markdown import pages
from tests.in_process import acrc
from tests.recorded_runs import record

TABLES = tables_of(CleaningTask.declaration)
PAGE = "docs/tables.md"
Rows = list[dict[str, Any]]


@pytest.fixture(scope="module")
def exported(recorded_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export a run as on the page, from a folder where `runs/tables` is the run."""
    here = tmp_path_factory.mktemp("exported")
    (here / "runs" / "tables").mkdir(parents=True)
    done = acrc("export", recorded_run, "--out", here / "runs" / "tables" / "tables")
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == len(TABLES)
    return here


@pytest.fixture(scope="module")
def tables(exported: Path) -> dict[str, Rows]:
    folder = exported / "runs" / "tables" / "tables"
    return {one.name: parquet.read_table(folder / f"{one.name}.parquet").to_pylist() for one in TABLES}


def test_files_and_page_have_the_columns_and_their_meanings(exported: Path) -> None:
    assert (REPOSITORY / PAGE).read_text().endswith(schema_page(CleaningTask.declaration))
    for table in TABLES:
        schema = parquet.read_schema(exported / "runs" / "tables" / "tables" / f"{table.name}.parquet")
        assert schema.names == [one.name for one in table.columns]
        assert schema.field(0).metadata == {b"meaning": table.columns[0].meaning.encode()}


def test_the_example_on_the_page_draws_a_picture(exported: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (block,) = (one for p in pages() if p.name == PAGE for one in p.blocks() if one.language == "python")
    monkeypatch.chdir(exported)
    monkeypatch.setenv("MPLBACKEND", "agg")
    exec(block.text, {"__name__": "__main__"})
    assert (exported / "error.png").read_bytes().startswith(b"\x89PNG")


def test_an_exchange_names_frame_and_fields(tables: dict[str, Rows]) -> None:
    one = next(row for row in tables["exchanges"] if row["robot"] == "r2")
    assert (one["seconds"], one["peer"], one["via"], one["hops"]) == (15.0, "r1", "r1", 0)
    assert one["heard"] + one["age"] == pytest.approx(15.0)
    frame = next(row for row in tables["frames"] if row["sender"] == "r1" and row["seconds"] == one["heard"])
    assert (frame["receiver"], frame["copy"]) == ("r2", "heard")
    assert frame["strength"] == pytest.approx(one["rssi"], abs=0.2)  # the chip has codes, about 5 to a dB
    fields = {
        row["field"]: json.loads(row["after"])
        for row in tables["knowledge"]
        if (row["process"], row["change"]) == ("r2", one["change"])
    }
    assert fields["destination.owner"] == "r1" and fields["state"] == "free"


def test_a_lean_run_has_the_tables_that_need_no_computation_of_robots(tmp_path: Path) -> None:
    record(tmp_path / "run", detail="lean", duration=3.0)
    stale = tmp_path / "tables" / "frames.parquet"
    stale.parent.mkdir()
    stale.touch()
    done = acrc("export", tmp_path / "run", "--out", tmp_path / "tables")
    assert done.returncode == 1
    assert {path.stem for path in stale.parent.iterdir()} == {"poses", "people", "places", "outcomes"}
    assert (
        "recorded lean, so estimates, goals, frames, knowledge, exchanges, decisions are missing"
        in done.stderr
    )
