"""A campaign's folder is sealed when the command ends, and whoever reads it holds it to that."""

from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.campaign import store
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.study.study import Study
from observation.results.seal import SUMS, SealError, check_seal, lines, seal


@pytest.fixture
def kept(tmp_path: Path) -> store.Store:
    """A campaign of one trial that has failed, sealed."""
    kept = store.create(tmp_path / "kept", Study("kept", "/s.toml", ("none",), 1))
    keep(kept.path(next(kept.study.trials())), TrialRecord("none", 1, {}, failure="it rained"))
    seal(kept.folder)
    return kept


def test_a_trial_that_was_changed_is_named_by_who_reads_or_goes_on(kept: store.Store) -> None:
    assert store.load(kept.folder).study == kept.study
    path = kept.path(next(kept.study.trials()))
    path.write_bytes(path.read_bytes().replace(b"rained", b"snowed"))
    attempts: tuple[Callable[[], object], ...] = (
        lambda: store.load(kept.folder),
        lambda: store.create(kept.folder, kept.study),
    )
    for attempt in attempts:
        with pytest.raises(SealError) as caught:
            attempt()
        assert str(caught.value) == f"{path}: was changed; its SHA-256 is not the one in SHA256SUMS"
    assert (kept.folder / SUMS).exists(), "nothing has gone on"


def test_a_trial_that_was_added_is_named(kept: store.Store) -> None:
    more = kept.folder / "trials" / "more.json"
    more.write_text("{}")
    with pytest.raises(SealError) as caught:
        store.load(kept.folder)
    assert str(caught.value) == (
        f"{more}: was added; SHA256SUMS does not list it, and it lies among the run's own files"
    )


def test_a_campaign_that_goes_on_is_unsealed_until_it_ends(kept: store.Store) -> None:
    store.create(kept.folder, Study("kept", "/s.toml", ("none",), 2))
    assert check_seal(kept.folder) is None
    assert store.load(kept.folder).study.seeds == 2


def test_a_report_is_made_anew_before_and_after_the_seal(kept: store.Store) -> None:
    page = kept.folder / "report" / "report.html"
    page.parent.mkdir()
    for text in ("while the campaign went on", "by an older version", "after it"):
        page.write_text(text)
        assert store.load(kept.folder).study == kept.study
        if text != "by an older version":
            seal(kept.folder)
            assert "report" not in (kept.folder / SUMS).read_text()
    sums = (kept.folder / SUMS).read_text().splitlines()[:-1]
    page.write_text("as an earlier version sealed it")
    told = lines({name: one for one, _, name in (line.partition("  ") for line in sums)} | {
        "report/report.html": "0" * 64
    })  # fmt: skip
    (kept.folder / SUMS).write_bytes(told)
    assert check_seal(kept.folder) is not None
