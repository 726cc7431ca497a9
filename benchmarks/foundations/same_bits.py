"""One scenario and seed run in several ways: whether all come to one digest, and replay to the same."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

from actors.installation.repository import SHIPPED
from actors.runtime.isolation.sandbox import available
from benchmarks.statistics.measured import Measured, table_of
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.replay.recheck import recheck

_SCENARIO: Final = SHIPPED / "scenarios" / "chapter.toml"


def check(duration: float = 120.0) -> Measured:
    """The chapter's scenario for so many simulated s, in every way that this machine has."""
    scenario = load_scenario(_SCENARIO, Overrides(duration=duration))
    ways = {
        "in memory": RunOptions(Path(), bus="memory", json=True),
        "processes, forked": RunOptions(Path(), isolate=False, json=True),
        "processes, started anew": RunOptions(Path(), spawn="exec", isolate=False, json=True),
        "processes, 20 times real time": RunOptions(Path(), speed="20", isolate=False, json=True),
    }
    if available() is None:
        ways["processes, isolated"] = RunOptions(Path(), isolate=True, json=True)
    rows, replayed = [], 0
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        for number, (way, options) in enumerate(ways.items()):
            out = Path(folder) / str(number)
            result = swarm.run(scenario, replace(options, out=out))
            rows.append({"run": way, "digest": result.digest, "undelivered": result.undelivered})
        replayed = recheck(out).outputs  # raises where a message is another one
    title = f"chapter.toml, {duration:g} s; the last one replayed: {replayed} messages, all equal"
    holds = len({row["digest"] for row in rows}) == 1 and not any(row["undelivered"] for row in rows)
    return Measured({"runs": rows, "replayed": replayed}, (table_of(rows, title),), holds)
