"""What is said of a run's progress where no terminal shows a bar."""

import io

import pytest
from rich.console import Console

from actors.messages import Progress
from deploy.run import progress


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
