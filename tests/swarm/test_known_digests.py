"""Known digests of short runs.

A digest covers every message of a run, so any change of behaviour in a core changes one. After an intended
change, `python -m tests.swarm.test_known_digests` prints the new values; CHANGELOG.md gives the reason.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest

from acrc_testbed.results.result import RunResult
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

ROOT: Final = Path(__file__).parents[2]
CHAPTER: Final = ROOT / "scenarios" / "chapter.toml"
CROWD: Final = Path(__file__).parent / "crowd.toml"
RUNS: Final = {
    "chapter": (CHAPTER, Overrides(robots=4, seed=42, duration=40.0)),
    "auction, robust": (
        CHAPTER,
        Overrides(robots=3, seed=7, duration=30.0, strategy="auction", navigation="robust"),
    ),
    "head_on": (ROOT / "scenarios" / "head_on.toml", Overrides(seed=1, duration=40.0)),
    "corridor": (ROOT / "scenarios" / "corridor.toml", Overrides(seed=1, duration=20.0)),
    "crowd": (CROWD, Overrides(seed=1)),
}
DIGESTS: Final = {
    "chapter": "e6a90d5b464b1b79a55a6e24662d2dac00a0641c4753fda518e9898bd038c281",
    "auction, robust": "dd59c007bdc83b97ed32c5f80c15ee1e55c445697e4c59c575f2e98926c38cb8",
    "head_on": "b916b573205f4ea50303420ce90285e68de558909b0919dfbed61d56c01ca9b2",
    "corridor": "108aa781307e9eb4f7be8b7ae0aca12bb639be8658ab857252c52ebca58e8d95",
    "crowd": "d7e3413ea2e8f1d8c02b8fe6b839b86acbdfccb3e635c161e68bb52e7259c718",
}


def result_of(name: str, out: Path) -> RunResult:
    file, overrides = RUNS[name]
    plan = swarm.plan(load_scenario(file, overrides), RunOptions(out, bus="memory", json=True))
    return swarm.run_in_memory(plan, lambda progress: None)


@pytest.mark.claim("digest")
@pytest.mark.parametrize("name", RUNS)
def test_digest_is_the_known_one(name: str, tmp_path: Path) -> None:
    result = result_of(name, tmp_path / "out")
    assert result.digest == DIGESTS[name]
    if name == "crowd":  # must contain contacts, relays and losses
        assert (result.contacts or 0) >= 100 and result.deeco.counters["relayed"] > 100
        assert result.frames["copies_heard"] > 100 and result.frames["frames_access_failure"] > 0
        assert min(result.deeco.exchanges.values()) > 5 and len(result.deeco.exchanges) == 2


if __name__ == "__main__":
    for known in RUNS:
        with TemporaryDirectory() as folder:
            print(f'    "{known}": "{result_of(known, Path(folder) / "out").digest}",')
