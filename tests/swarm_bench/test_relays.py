"""That the benchmark of relays runs each rule from each seed, and that its ages are true ones."""

from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from benchmarks.statistics.measured import Measured
from benchmarks.swarm import relays
from benchmarks.swarm.relays import SCENARIO, RelayFigures, RelayTask, examine, relay_scenario
from deploy.scenario.scenario_file import Overrides, load_scenario


@pytest.fixture(scope="module")
def measured() -> Measured:
    return relays.measure((4,), 15.0, below=(-90.0,), seed=3)


def test_each_rule_runs_from_each_seed(measured: Measured) -> None:
    found = [RelayFigures(**one) for one in measured.figures]
    own = load_scenario(SCENARIO).deeco.relay_below
    rules = sorted({0.0, own, -90.0}, reverse=True)
    assert [(one.seed, one.below_dbm) for one in found] == [(seed, rule) for seed in (3, 4) for rule in rules]
    for one in found:
        assert 0.0 < one.age_s <= one.age_95_s and one.age_s <= one.capped_age_s <= 10.0
        assert one.frames == pytest.approx(one.relays + 1, rel=0.2), "a publication a second, frames shared"
    everybody, *_, hardly = found[: len(rules)]
    assert hardly.relays < everybody.relays and hardly.packets < everybody.packets


def test_the_scenario_itself_is_not_changed_but_for_the_rule() -> None:
    plain = load_scenario(SCENARIO, Overrides(robots=4, seed=3, duration=15.0))
    scenario = relay_scenario(RelayTask(SCENARIO, 4, 3, 15.0, -90.0))
    assert scenario.deeco == plain.deeco.model_copy(update={"relay": True, "relay_below": -90.0})
    assert scenario.model_copy(update={"deeco": plain.deeco}) == plain


def test_the_table_says_which_rule_is_the_scenarios(
    measured: Measured, capsys: pytest.CaptureFixture[str]
) -> None:
    measured.show()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].strip() == "4 robots, means over 2 seeds"
    assert sum(" * " in line for line in lines if line.startswith("│")) == 1
    assert lines[-1].startswith("4 robots, ≤ -90 dBm: relays -")


def test_robots_that_never_talk_are_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "mute.toml"
    floor = SCENARIO.parents[1] / "maps" / "corridor.yaml"
    path.write_text(f'map = "{floor}"\n[run]\nstrategy = "tests.robot.behaviours:idle"\n')
    with pytest.raises(OptionError, match="they should talk"):
        examine(RelayTask(path, 2, 1, 15.0, -80.0))


@pytest.mark.parametrize(
    ("robots", "duration", "sentence"),
    [((1, 4), 20.0, "--robots: 1; must be at least 2 for relays"),
     ((4,), 14.0, "--duration: 14; must be at least 15 for relays")],
)  # fmt: skip
def test_too_few_robots_and_too_short_runs_are_refused(
    robots: tuple[int, ...], duration: float, sentence: str
) -> None:
    with pytest.raises(OptionError) as caught:
        relays.measure(robots, duration)
    assert str(caught.value) == sentence
