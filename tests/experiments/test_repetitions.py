"""Repetitions of trials as processes, and records that a trial's process leaves."""

import os
from pathlib import Path

import msgspec
import pytest

from experiments.campaign import store
from experiments.campaign.campaign import CampaignOptions, carry_out
from experiments.campaign.store import Store
from experiments.campaign.trial_order import MOST_BYTES, left, received
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.campaign.trust import IN_MEMORY, ISOLATED, differing, protection
from experiments.report import charts
from experiments.report.cases import read
from experiments.report.report import compose
from experiments.study.study import Study, Trial
from observation.results.result import RunResult
from tests.experiments.test_campaign_command import acrc

ROOT = Path(__file__).parents[2]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
SHORT = (("robots.count", 2), ("run.duration", 2.0))
CHEAT = '''
"""Reaches the referee through the stack; in a process of its own there is none."""

import sys
from cleaning.strategies.none import behaviour as honest
from msgspec.structs import replace


def world():
    frame = sys._getframe()
    while frame is not None:
        for shell in frame.f_locals.get("shells", ()):
            if hasattr(shell.core, "_task"):
                return shell.core
        frame = frame.f_back
    return None


class Cheat:
    def __init__(self, start):
        self.honest, self.done = honest(start), False

    def advance(self, view, until):
        core = world()
        if core is not None and not self.done:
            self.done = True
            say = core._task.outcome
            core._task.outcome = lambda present: {"places": tuple(map(settled, say(present)["places"]))}
        return self.honest.advance(view, until)


def settled(one):
    return replace(one, reached_at=0, reached_by=one.owner, reported_at=1, reported_by=one.owner)


def quiet(start):
    return Cheat(start)
'''


@pytest.fixture(scope="module")
def cheated(tmp_path_factory: pytest.TempPathFactory, forked_servers: None) -> Store:
    """Run a strategy that changes the referee's result beside an honest one."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "cheat.py").write_text(CHEAT)
    (folder / "s.toml").write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    names = ("none", "cheat:quiet")
    kept = store.create(folder / "out", Study("of-cheats", str(folder / "s.toml"), names, 2, settings=SHORT))
    carry_out(kept, CampaignOptions(jobs=2, check_every=20, modules=(folder,)))
    return kept


@pytest.mark.timeout(240)
def test_a_strategy_that_changes_its_result_in_memory_is_found(cheated: Store) -> None:
    assert [(check.strategy, check.seed) for check in cheated.checks()] == [("none", 1), ("cheat:quiet", 1)]
    honest, caught = cheated.checks()
    assert honest.agrees and not caught.agrees
    assert caught.in_memory == caught.over_zenoh, "messages are the same, so is the digest"
    assert "places_done 20 in memory, 0 there" in caught.differs
    (sentence,) = differing(cheated)
    assert sentence.startswith("cheat:quiet with seed 1 is another run over Zenoh than in memory: ")


def test_every_nth_trial_of_each_strategy_is_repeated(plain: RunResult, tmp_path: Path) -> None:
    kept = store.create(tmp_path / "out", Study("s", str(CORRIDOR), ("none", "chapter"), 5))
    for trial in kept.study.trials():
        keep(kept.path(trial), TrialRecord(trial.strategy, trial.seed, {}, plain))
    chosen = [pending.trial for pending in kept.unchecked(2)]
    assert sorted((trial.strategy, trial.seed) for trial in chosen) == [
        (strategy, seed) for strategy in ("chapter", "none") for seed in (1, 3, 5)
    ]
    kept.check_path(chosen[0]).write_text("{}")
    assert [pending.trial for pending in kept.unchecked(2)] == chosen[1:]


def test_compare_and_report_name_it_first(cheated: Store) -> None:
    code, out, err = acrc("compare", str(cheated.folder))
    assert code == 1
    assert out.splitlines()[0] == IN_MEMORY
    assert out.splitlines()[1].startswith("2 of 4 runs were repeated as processes (")
    assert f"acrc: {differing(cheated)[0]}" in err
    with charts.applied():
        page = compose(read([cheated.folder]))
    assert IN_MEMORY in page.asked
    assert page.found[0].startswith("out: cheat:quiet with seed 1")
    assert "nothing that this campaign shows can be trusted" in page.found[0]


@pytest.mark.timeout(240)
def test_a_campaign_for_strangers_makes_every_run_as_isolated_processes(tmp_path: Path) -> None:
    (tmp_path / "cheat.py").write_text(CHEAT)
    (tmp_path / "s.toml").write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    (tmp_path / "study.toml").write_text(
        'scenario = "s.toml"\nstrategies = ["cheat:quiet"]\nseeds = 1\nisolated = true\n'
        'conditions = "as written"\n'
        '[set]\n"robots.count" = 2\n"run.duration" = 2.0\n'
    )
    out = tmp_path / "out"
    code, said, err = acrc(
        "campaign", str(tmp_path / "study.toml"), "--modules", ".", "--out", str(out), cwd=tmp_path
    )
    assert code == 0, err
    assert said.splitlines()[0] == ISOLATED
    (record,) = store.load(out).records()
    assert record.result is not None and record.trace and record.time
    assert (record.result.isolation, record.result.places_done) == ("full", 0)
    kept = store.load(out)
    trial = next(kept.study.trials())
    untold = msgspec.structs.replace(record.result, isolation="credentials")
    keep(kept.path(trial), msgspec.structs.replace(record, result=untold))
    assert protection(kept) == ["1 of 1 runs were NOT isolated, as the study wants."]


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"[" * 100_000, "its process has left no record of a trial: "),
        (b'{"strategy": 3}', "its process has left no record of a trial: "),
        (b"\xff\xfe", "its process has left no record of a trial: "),
        (b'{"strategy":"x","seed":9,"variant":{}}', "its process has left a record with neither result nor"),
        (None, "it died"),
    ],
)
def test_what_a_process_leaves_is_a_record_or_a_failure(content: bytes | None, why: str) -> None:
    record = received(content, Trial("none", 1, (("robots.count", 2),)), "it died")
    assert record.failure is not None and record.failure.startswith(why)
    assert (record.strategy, record.seed, record.variant) == ("none", 1, {"robots.count": 2})


def test_a_record_of_another_trial_is_none(plain: RunResult) -> None:
    other = msgspec.json.encode(TrialRecord("none", 2, {}, plain))
    assert received(other, Trial("none", 1), "").failure == "its process has left the record of another trial"


def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "secret").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "secret")
    with (tmp_path / "large").open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    for name in ("pipe", "link", "large", "nothing"):
        assert left(tmp_path / name, MOST_BYTES) is None
    (tmp_path / "log").write_text("first last")
    assert left(tmp_path / "log", 4, end=True) == b"last"
