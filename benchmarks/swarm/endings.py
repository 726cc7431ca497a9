"""Runs that are killed, stopped and sent signals at random instants: what they say, and what they leave."""

import json
import signal
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from actors.console import screen
from benchmarks.statistics.commands import answer
from benchmarks.statistics.measured import Measured, table_of
from benchmarks.swarm.endings_trial import MODES, Ending, EndingsTask, attempt, deed, run_words


def check(runs: int = 200, seed: int = 1, longest_stop: float = 60.0, workers: int = 4) -> Measured:
    """Kill, stop and signal so many runs; it holds where each ends, or goes on, as it must.

    `longest_stop`: processes are stopped for 5 s to so long. `workers`: so many runs at a time.
    """
    task = EndingsTask(runs, seed, longest_stop=longest_stop)
    console = screen(stderr=True)
    _obeyed_by_children()
    digest = _undisturbed(task)
    endings: list[Ending] = []
    with ThreadPoolExecutor(workers) as pool:
        deeds = [deed(number, task) for number in range(task.count)]
        for ending in pool.map(lambda one: attempt(one, task, digest), deeds):
            endings.append(ending)
            for fault in ending.faults:
                console.print(f"{len(endings)}: {ending.deed}: {fault}")
    rows = table_rows(endings)
    table = table_of(rows, f"{task.count} runs, seed {task.seed}")
    return Measured(rows, (table,), not any(ending.faults for ending in endings))


def table_rows(endings: Sequence[Ending]) -> list[dict[str, object]]:
    """One row for each way to start and each signal, and the sums."""
    groups: list[tuple[str, str, list[Ending]]] = []
    for mode in MODES:
        numbers = sorted({one.deed.number for one in endings if one.deed.mode == mode})
        for number in numbers:
            chosen = [one for one in endings if (one.deed.mode, one.deed.number) == (mode, number)]
            groups.append((mode, number.name, chosen))
    groups.append(("all", "", list(endings)))
    rows: list[dict[str, object]] = []
    for mode, name, chosen in groups:
        came = Counter(one.came for one in chosen)
        outcome = {word: came[word] for word in ("ended", "went on", "missed", "hung")}
        faulty = sum(bool(one.faults) for one in chosen)
        rows.append(
            {"started by": mode, "signal": name, "runs": len(chosen), **outcome, "not as due": faulty}
        )
    return rows


def _obeyed_by_children() -> None:
    """Let what is started obey signals that this process was told to ignore, as by nohup or in a background.

    A signal that is ignored stays so in every process that is started; one that is handled does not.
    """
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, lambda _number, _frame: None)


def _undisturbed(task: EndingsTask) -> str:
    """The digest of the run when nothing is done to it."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        told = answer(*run_words(Path(folder) / "out", "forkserver", task))
    digest: str = json.loads(told)["digest"]
    return digest
