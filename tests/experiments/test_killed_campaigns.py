"""A campaign that is killed at random instants continues without losing or repeating a trial."""

import random
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from acrc_testbed.experiments import store
from acrc_testbed.experiments.campaign import CampaignOptions, run_campaign
from tests.swarm.command import start


def written(folder: Path, files: str = "trials/*.json") -> dict[str, int]:
    """Modification times of the records, ns."""
    found = {}
    for path in folder.glob(files):
        with suppress(FileNotFoundError):
            found[path.name] = path.stat().st_mtime_ns
    return found


def digests(folder: Path) -> dict[tuple[str, int], str | None]:
    return {
        (record.strategy, record.seed): record.result.digest if record.result else None
        for record in store.load_store(folder).records()
    }


def start_and_kill(words: tuple[object, ...], folder: Path, after_s: float) -> None:
    """Kill the campaign `after_s` after one of its trials has begun."""
    began_ns = time.time_ns()
    with start("campaign", *words, "--out", folder) as process:
        while process.poll() is None and max(written(folder, "logs/*.log").values(), default=0) < began_ns:
            time.sleep(0.02)
        try:
            process.communicate(timeout=after_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)


@pytest.mark.claim("resume")
@pytest.mark.usefixtures("forked_servers")
@pytest.mark.timeout(600)
def test_a_killed_campaign_continues(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    kills, duration_s = (10, 20.0) if full else (1, 3.0)
    words = (
        *("--strategies", "none,chapter", "--seeds", kills, "--robots", 2),
        *("--duration", duration_s, "--check-every", 0),
    )
    cut, rng = tmp_path / "cut", random.Random(4)
    kept: dict[str, int] = {}
    for _ in range(kills):
        start_and_kill(words, cut, rng.uniform(0.0, 2.0 + duration_s / 20))
        now = written(cut)
        assert kept.items() <= now.items(), "a finished trial is not made again"
        kept = now
    record_property("trials kept after the last kill", len(kept))
    campaign = store.load_store(cut)
    run_campaign(campaign, CampaignOptions(jobs=2, check_every=0))
    assert kept.items() <= written(cut).items()
    whole = store.create_store(tmp_path / "whole", campaign.study)
    run_campaign(whole, CampaignOptions(jobs=2, check_every=0))
    assert len(digests(cut)) == 2 * kills and digests(cut) == digests(tmp_path / "whole")
