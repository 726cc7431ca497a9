"""What is said of a run's progress where no terminal shows a bar."""

import io

import pytest
from rich.console import Console

from actors.messages import Progress
from command_line.experiments import campaigns
from deploy.run import progress
from experiments.campaign.campaign import CampaignProgress


def test_in_a_log_there_is_a_line_every_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("deploy.run.progress.time.monotonic", lambda: now[0])
    with progress.shown(600_000_000, 40, quiet=False) as follow:
        for second in range(25):
            now[0] = float(second)
            follow(Progress(second, second * 4_000_000, 40 - second, second, finished=False))
    assert capsys.readouterr().err.splitlines() == [
        "acrc: 40 of 600 s simulated, 10 of 40 places",
        "acrc: 80 of 600 s simulated, 20 of 40 places",
    ]


def test_a_campaign_says_the_same_of_its_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("deploy.run.progress.time.monotonic", lambda: now[0])
    with campaigns.shown(quiet=False) as follow:
        for second in range(35):
            now[0] = float(second)
            left_s = None if second < 15 else 400.0 - second
            follow(CampaignProgress(min(second, 20), second // 8, 20, left_s))
    assert capsys.readouterr().err.splitlines() == [
        "acrc: 10 of 20 runs, 1 failed",
        "acrc: 20 of 20 runs, 2 failed, repeating some to check them, about 6 min left",
        "acrc: 20 of 20 runs, 3 failed, repeating some to check them, about 6 min left",
    ]
    with campaigns.shown(quiet=True) as follow:
        now[0] = 99.0
        follow(CampaignProgress(1, 0, 20, 9.0))
    assert capsys.readouterr().err == ""


def test_a_quiet_run_says_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with progress.shown(600_000_000, 40, quiet=True) as follow:
        monkeypatch.setattr(progress, "EVERY_S", -1.0)
        follow(Progress(1, 4_000_000, 40, 0, finished=False))
    assert capsys.readouterr().err == ""


def test_a_long_line_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    there = io.StringIO()
    monkeypatch.setattr(progress, "EVERY_S", -1.0)
    progress.lines(Console(file=there, width=20))("word " * 30)
    assert there.getvalue().count("\n") == 1
