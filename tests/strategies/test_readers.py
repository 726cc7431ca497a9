"""All commands that read runs, on a run of each shipped strategy and example."""

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from acrc_testbed.command_line.app import app
from actors.installation.repository import REPOSITORY
from actors.user_code import set_folders
from cleaning.strategies import STRATEGIES

EXAMPLE = "examples.courteous:behaviour"
RUN = "run scenarios/{scenario}.toml --strategy {strategy} --duration {seconds} --bus memory --out {out}"
READERS = (
    "explain {out} r1 --modules .", "causes {out}", "record check {out}", "record info {out}",
    "branch {out}@0.5 --modules . --out {out}/../branch",
    "view {out} --png --html --svg", "view {out} --json", "replay {out} --modules .",
    "replay {out} --robot r2 --modules . --no-isolate", "export {out}",
    "export {out} --mcap ros2",
    "report {out}", "causes {out}", "record echo {out} r1/drive",
    "record plot {out} r1/drive vx --out {out}/vx.png",
)  # fmt: skip


def call(words: str) -> None:
    try:
        app(shlex.split(words), prog_name="acrc", standalone_mode=False)
    except SystemExit as end:
        assert not end.code, words


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(REPOSITORY)
    yield
    set_folders(())


@pytest.mark.nightly
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("strategy", [*STRATEGIES, EXAMPLE])
def test_a_run_of_every_strategy_is_read_by_every_command(strategy: str, tmp_path: Path) -> None:
    readers: tuple[str, ...] = READERS
    if strategy == "oracle":  # its robots share memory, so none of them can be replayed alone
        alone = ("explain", "export", "replay {out} --robot")
        readers = tuple(words for words in readers if not words.startswith(alone))
    scenario = "logistics" if strategy.startswith("logistics-") else "head_on"
    for words in (RUN, *readers):
        call(words.format(scenario=scenario, strategy=strategy, seconds=3, out=tmp_path / "run"))
