"""Campaigns on a Dask cluster of real worker processes."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from experiments.campaign import store
from experiments.campaign.campaign import CampaignOptions, carry_out
from experiments.campaign.cluster_address import tcp
from experiments.study.study import Study
from tests import warm

ROOT = Path(__file__).parents[2]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
STUDY = Study(
    "short",
    str(CORRIDOR),
    ("none", "chapter"),
    2,
    settings=(("robots.count", 2), ("run.duration", 3.0)),
)
WORDS = (
    *("campaign", "--scenario", str(CORRIDOR), "--strategies", "none,chapter", "--seeds", "2"),
    *("--set", "robots.count=2", "--set", "run.duration=3.0", "--check-every", "0", "--json"),
)


class Cluster:
    """A scheduler and two workers, each a process of its own."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._folder = folder
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._stack = stack
        self._begin("scheduler", "dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port))
        address = f"tcp://127.0.0.1:{self.port}"
        self.workers = [
            self._begin(f"w{number}", "dask_worker", address, "--nthreads", "1", "--no-nanny")
            for number in range(2)
        ]
        for number in range(2):
            self._await(f"w{number}", "Registered to")

    def _begin(self, name: str, program: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
        log = self._stack.enter_context((self._folder / f"{name}.log").open("wb"))
        process = subprocess.Popen(command, cwd=self._folder, stdout=log, stderr=log)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process

    def _await(self, name: str, words: str) -> None:
        for _ in range(600):
            if words in (self._folder / f"{name}.log").read_text():
                return
            time.sleep(0.1)
        raise AssertionError((self._folder / f"{name}.log").read_text())


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with ExitStack() as stack:
        yield Cluster(stack, tmp_path)


def campaign(*words: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "deploy", *WORDS, *words]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def digests(folder: Path) -> dict[tuple[str, int], str | None]:
    return {
        (record.strategy, record.seed): record.result.digest if record.result else record.failure
        for record in store.load(folder).records()
    }


@pytest.mark.timeout(240)
def test_a_worker_that_is_killed_loses_and_changes_nothing(cluster: Cluster, tmp_path: Path) -> None:
    alone, there = tmp_path / "alone", tmp_path / "there"
    carry_out(store.create(alone, STUDY), CampaignOptions(jobs=2))
    with campaign("--on", f"dask://127.0.0.1:{cluster.port}", "--out", str(there)) as process:
        while process.poll() is None and not list(there.glob("trials/*.json")):
            time.sleep(0.05)
        os.kill(cluster.workers[0].pid, signal.SIGKILL)
        out, err = process.communicate()
    assert process.returncode == 0, err
    assert '"failed": 0' in out
    assert digests(there) == digests(alone)


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("dask://nowhere", "--on: dask://nowhere; must be the address of a scheduler, such as dask://192"),
        ("tcp://127.0.0.1:8786", "--on: tcp://127.0.0.1:8786; must be the address of a scheduler"),
        ("dask://127.0.0.1:1", "--on dask://127.0.0.1:1: no Dask scheduler answers there"),
    ],
)
def test_a_wrong_address_is_one_sentence(address: str, sentence: str, tmp_path: Path) -> None:
    words = [*WORDS, "--on", address, "--out", str(tmp_path / "out")]
    done = warm.run(words, tmp_path, os.environ, 60.0, finds_cwd=False)
    assert done.returncode in {1, 2} and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"acrc: {sentence}")


def test_addresses() -> None:
    assert tcp("dask://cluster.example-1.org:8786") == "tcp://cluster.example-1.org:8786"
    assert tcp("dask://[::1]:8786") == "tcp://[::1]:8786"
