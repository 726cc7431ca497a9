"""Strategies that cheat in memory are found out, and none can see which of its runs will be repeated."""

import hashlib
import json
import math
import os
from pathlib import Path

import msgspec
import pytest

from experiments.campaign import store
from experiments.campaign.campaign import CampaignOptions, carry_out
from experiments.campaign.draw import DrawableRun, draw, run_of
from experiments.campaign.store import Store
from experiments.campaign.trial_order import MOST_BYTES, left, received
from experiments.campaign.trial_record import TrialRecord, keep
from experiments.campaign.trust import IN_MEMORY, ISOLATED, differing, protection
from experiments.report import style
from experiments.report.cases import read
from experiments.report.report import compose
from experiments.study.study import Study, Trial
from observation.results.result import RunResult
from tests.experiments.test_campaign_command import acrc

ROOT = Path(__file__).parents[2]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
SHORT = (("robots.count", 2), ("run.duration", 2.0))
CHEAT = '''
"""Reaches the referee through the stack, where there is one; as a process of its own it has none."""

import json, os, sys
from cleaning.strategies.none import behaviour as honest
from msgspec.structs import replace

SEEN = {seen!r}


def frames():
    frame = sys._getframe()
    while frame is not None:
        yield frame
        frame = frame.f_back


def world():
    for frame in frames():
        for shell in frame.f_locals.get("shells", ()):
            if hasattr(shell.core, "_task"):
                return shell.core
    return None


class Cheat:
    def __init__(self, start, when, how):
        self.honest, self.when, self.how, self.done = honest(start), when, how, False

    def advance(self, view, until):
        core = world()
        if core is not None and not self.done and self.when(core):
            self.done = True
            self.how(core)
        return self.honest.advance(view, until)


def settled(one):
    return replace(one, reached_at=0, reached_by=one.owner, reported_at=1, reported_by=one.owner)


def of_the_end(core):
    """Only what the referee says last: no message, so the digest, is otherwise."""
    say = core._task.outcome
    core._task.outcome = lambda present: {{"places": tuple(map(settled, say(present)["places"]))}}


def is_not_repeated(core):
    """As trials were once chosen: by their number, the first and every so many from there on."""
    numbers = [frame.f_locals["number"] for frame in frames() if "number" in frame.f_locals]
    note = {{
        "numbers": repr(numbers), "argv": sys.argv, "cwd": os.getcwd(), "environ": dict(os.environ),
        "title": open("/proc/self/cmdline").read(),
        "files": [os.path.realpath(f"/proc/self/fd/{{one}}") for one in os.listdir("/proc/self/fd")],
        "locals": [repr(value) for frame in frames() for value in frame.f_locals.values()],
    }}
    with open(SEEN + str(core._setup.seed), "w") as file:
        json.dump(note, file)
    return numbers[0] % 20 if numbers and isinstance(numbers[0], int) else core._setup.seed != 1


def quiet(start):
    return Cheat(start, lambda core: True, of_the_end)


def adaptive(start):
    return Cheat(start, is_not_repeated, of_the_end)
'''


@pytest.fixture(scope="module")
def cheated(tmp_path_factory: pytest.TempPathFactory, forked_servers: None) -> Store:
    """Two cheats beside an honest strategy, with three seeds each; one run in 20 of each is repeated."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "cheat.py").write_text(CHEAT.format(seen=str(folder / "seed-")))
    (folder / "s.toml").write_text(CORRIDOR.read_text().replace("../maps", str(ROOT / "maps")))
    names = ("none", "cheat:quiet", "cheat:adaptive")
    kept = store.create(folder / "out", Study("of-cheats", str(folder / "s.toml"), names, 3, settings=SHORT))
    carry_out(kept, CampaignOptions(jobs=2, check_every=20, modules=(folder,)))
    return kept


@pytest.mark.timeout(240)
@pytest.mark.parametrize("cheat", ["quiet", "adaptive"])
def test_a_strategy_that_reaches_the_referee_in_memory_is_found_out(cheated: Store, cheat: str) -> None:
    name = f"cheat:{cheat}"
    won = [one.result.places_done for one in cheated.records() if one.strategy == name and one.result]
    assert max(won) == 20, "it does cheat"
    caught = [check for check in cheated.checks() if check.strategy == name and not check.agrees]
    assert caught
    if cheat == "quiet":
        assert caught[0].in_memory == caught[0].over_zenoh, "messages are the same, so is the digest"
        assert "places_done 20 in memory, 0 there" in caught[0].differs
    assert any(line.startswith(f"{name} with seed ") for line in differing(cheated))
    assert not any(line.startswith("none ") for line in differing(cheated))


def test_a_run_in_memory_cannot_see_that_it_will_be_repeated(cheated: Store) -> None:
    """The adaptive cheat wrote down all that it could see, and cheated where it thought itself safe."""
    notes = [(cheated.folder.parent / f"seed-{seed}").read_text() for seed in (1, 2, 3)]
    names = [trial.name for trial in cheated.study.trials()]
    hidden = (str(cheated.folder), "of-cheats", "cheat:quiet", "draws", *names)
    for note in notes:
        assert json.loads(note)["numbers"] == "[]"
        assert [word for word in hidden if word in note] == []


def test_lots_are_drawn_once_all_runs_have_ended_and_anybody_can_draw_them_again(cheated: Store) -> None:
    (made,) = cheated.draws
    drawn_ns = cheated.draws_file.stat().st_mtime_ns
    trials = {trial.name: trial for trial in cheated.study.trials()}
    assert set(made.among) == set(trials)
    for name, trial in trials.items():
        path = cheated.path(trial)
        assert path.stat().st_mtime_ns <= drawn_ns
        assert made.among[name] == hashlib.sha256(path.read_bytes()).hexdigest()
    lots = sorted(
        trials, key=lambda name: hashlib.sha256(bytes.fromhex(made.entropy) + name.encode()).digest()
    )
    first = {
        strategy: next(name for name in lots if trials[name].strategy == strategy)
        for strategy in cheated.study.strategies
    }
    assert set(made.by_lot) == set(first.values())
    assert {trials[name].strategy for name in made.odd} == set(cheated.study.strategies)
    assert {check.strategy for check in cheated.checks()} == set(cheated.study.strategies)
    assert cheated.unchecked() == [] and not cheated.draw_again(20)


def test_compare_and_report_say_it_before_all_else(cheated: Store) -> None:
    code, out, err = acrc("compare", str(cheated.folder))
    assert code == 1
    assert out.splitlines()[0] == IN_MEMORY
    assert out.splitlines()[1].startswith(
        "6 of 9 runs, drawn after all had ended, were repeated as processes ("
    )
    quiet = next(line for line in differing(cheated) if line.startswith("cheat:quiet"))
    assert err.splitlines()[0].startswith("acrc: cheat:") and err.count(f"acrc: {quiet}") == 2
    with style.applied():
        page = compose(read([cheated.folder]))
    assert IN_MEMORY in page.asked
    assert page.found[0].startswith("out: cheat:quiet with seed ")
    assert "nothing that this campaign shows can be trusted" in page.found[0]


def a_record(strategy: str, seed: int, plain: RunResult, places: int, claimed: int = 40) -> TrialRecord:
    robots = {"r1": msgspec.structs.replace(plain.per_robot["r1"], places_done=places)}
    result = msgspec.structs.replace(
        plain, seed=seed, places_total=40, places_done=places, places_claimed=claimed, per_robot=robots
    )
    return TrialRecord(strategy, seed, {}, result)


def a_run(strategy: str, seed: int, plain: RunResult, places: int, claimed: int = 40) -> DrawableRun:
    record = a_record(strategy, seed, plain, places, claimed)
    run = run_of(Trial(strategy, seed), record, f"{strategy}{seed}")
    assert run is not None
    return run


def test_what_was_won_oddly_is_repeated_beside_the_lots(plain: RunResult) -> None:
    """One run of 40 far above its strategy's others, and one that contradicts itself, whatever the lots."""
    runs = [a_run("a", seed, plain, 20 + seed % 2) for seed in range(1, 41)]
    runs += [a_run("b", seed, plain, 40 if seed == 17 else 20) for seed in range(1, 41)]
    liar = a_run("b", 23, plain, 20, claimed=3)
    runs = [liar if run.trial == liar.trial else run for run in runs]
    drawn = set()
    for entropy in (b"one", b"two", b"three"):
        made = draw(runs, 40, entropy)
        assert len(made.by_lot) == 2
        assert made.odd[liar.trial.name] == "it has more places done than were reported, or than there are"
        if Trial("b", 17).name not in made.by_lot:
            assert made.odd[Trial("b", 17).name] == (
                "scores +0.500 beside its strategy's median, +0.475 beside others with its seed"
            )
        drawn.add(made.by_lot)
    assert len(drawn) > 1, "another entropy, other lots"


def test_every_run_is_as_likely_to_be_drawn(plain: RunResult) -> None:
    runs = [a_run("a", seed, plain, 20) for seed in range(1, 11)]
    counts = dict.fromkeys((run.trial.name for run in runs), 0)
    for number in range(2000):
        for name in draw(runs, 10, number.to_bytes(4)).by_lot:
            counts[name] += 1
    assert sum(counts.values()) == 2000
    assert max(abs(count - 200) for count in counts.values()) < 5 * math.sqrt(180)


def test_with_more_seeds_the_new_runs_are_drawn_among_by_themselves(plain: RunResult, tmp_path: Path) -> None:
    def keep_all(kept: Store) -> None:
        for pending in kept.pending():
            record = a_record(pending.trial.strategy, pending.trial.seed, plain, 20)
            keep(kept.path(pending.trial), record)

    study = Study("s", str(CORRIDOR), ("none", "chapter"), 2)
    kept = store.create(tmp_path / "out", study)
    keep_all(kept)
    assert kept.draw_again(20)
    more = store.create(tmp_path / "out", msgspec.structs.replace(study, seeds=4))
    before, first = {trial.name for trial in kept.study.trials()}, more.draws[0]
    assert more.undrawn == 0
    forged = next(trial for trial in more.study.trials() if trial.seed == 3)
    more.check_path(forged).write_text("of a run that guessed that it would be drawn")
    keep_all(more)
    assert more.undrawn == 4
    assert more.draw_again(20)
    assert more.draws[0] == first and more.undrawn == 0
    assert not set(more.draws[1].among) & before
    assert more.draws[1].entropy != first.entropy
    assert not more.check_path(forged).exists()
    assert not more.draw_again(20)
    assert more.draw_again(2), "who wants more of them gets more, drawn anew among all"
    assert set(more.draws[2].among) == {trial.name for trial in more.study.trials()}


def test_a_record_that_changes_after_the_draw_is_told_and_drawn_again(
    plain: RunResult, tmp_path: Path
) -> None:
    kept = store.create(tmp_path / "out", Study("s", str(CORRIDOR), ("none",), 1))
    (trial,) = kept.study.trials()
    keep(kept.path(trial), a_record("none", 1, plain, 20))
    kept.draw_again(20)
    assert differing(kept) == []
    keep(kept.path(trial), a_record("none", 1, plain, 40))
    (said,) = differing(kept)
    assert said == (
        f"none with seed 1: its record {trial.name}.json was changed after the repetitions were drawn; its "
        "digest and its numbers are somebody's word"
    )
    assert kept.draw_again(20)
    assert differing(kept) == [] and [one.trial for one in kept.unchecked()] == [trial]


@pytest.mark.timeout(240)
def test_a_campaign_for_strangers_makes_every_run_as_isolated_processes(tmp_path: Path) -> None:
    (tmp_path / "cheat.py").write_text(CHEAT.format(seen=str(tmp_path / "seed-")))
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
    other = msgspec.json.encode(a_record("none", 2, plain, 20))
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
