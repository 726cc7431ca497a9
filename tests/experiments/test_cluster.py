"""Campaigns on a Dask cluster of real worker processes."""

import os
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dask
import pytest
import yaml

from acrc_testbed.experiments import store
from acrc_testbed.experiments.trial_pool import validated_answer
from acrc_testbed.experiments.trial_record import MAX_BYTES, TrialOutcome
from actors.installation.usage import OptionError
from deploy.hosts.address import check_address, is_safe
from deploy.hosts.connection import ClusterError, check_tls, create_security
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests import warm
from tests.helpers import free_port

pytestmark = pytest.mark.usefixtures("forked_servers")
ROOT = Path(__file__).parents[2]
CORRIDOR = ROOT / "scenarios" / "corridor.toml"
SHORT = (("robots.count", 2), ("run.duration", 3.0))
WORDS = (
    *("campaign", "--scenario", str(CORRIDOR), "--strategies", "chapter", "--seeds", "3"),
    *("--set", "robots.count=2", "--set", "run.duration=3.0", "--check-every", "0", "--json"),
)


MAKE_KEY = (
    "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 365 "
    "-subj /CN=cluster -keyout cluster.key -out cluster.pem"
)
"""Configuration as in docs/clusters.md."""
CONFIGURATION = (ROOT / "docs" / "clusters.md").read_text().partition("```yaml\n")[2].partition("```")[0]


def make_key(folder: Path) -> Path:
    """Write key, certificate and Dask's configuration as in docs/clusters.md; return their folder."""
    folder.mkdir()
    subprocess.run(MAKE_KEY.split(), cwd=folder, check=True, capture_output=True)
    return configure(folder, folder / "cluster.pem", folder / "cluster.pem", folder / "cluster.key")


def configure(folder: Path, authority: Path, certificate: Path, key: Path) -> Path:
    text = CONFIGURATION.replace("ca-file: /home/ada/cluster.pem", f"ca-file: {authority}")
    text = text.replace("/home/ada/cluster.pem", str(certificate)).replace("/home/ada/cluster.key", str(key))
    (folder / "cluster.yaml").write_text(text)
    return folder


class Cluster:
    """A scheduler and two workers, each a process of its own, with TLS."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._folder = folder
        self._environment = os.environ | {"DASK_CONFIG": str(make_key(folder / "keys"))}
        self.port = free_port()
        self._stack = stack
        place = ("--protocol", "tls", "--host", "127.0.0.1", "--port", str(self.port))
        self._begin("scheduler", "dask_scheduler", *place)
        self.address = f"tls://127.0.0.1:{self.port}"
        self.workers = [
            self._begin(f"w{number}", "dask_worker", self.address, "--nthreads", "1", "--no-nanny")
            for number in range(2)
        ]
        for number in range(2):
            self._await(f"w{number}", "Registered to")

    def _begin(self, name: str, program: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{program}", *words, "--no-dashboard"]
        log = self._stack.enter_context((self._folder / f"{name}.log").open("wb"))
        process = subprocess.Popen(command, cwd=self._folder, stdout=log, stderr=log, env=self._environment)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process

    def _await(self, name: str, words: str) -> None:
        for _ in range(600):
            if words in (self._folder / f"{name}.log").read_text():
                return
            time.sleep(0.1)
        raise AssertionError((self._folder / f"{name}.log").read_text())

    def campaign(self, *words: str) -> warm.ForkedCommand:
        begun = warm.begin([*WORDS, "--on", self.address, *words], ROOT, self._environment, finds_cwd=True)
        self._stack.callback(begun.kill)
        return begun


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with ExitStack() as stack:
        yield Cluster(stack, tmp_path)


def digests(folder: Path) -> dict[tuple[str, int], str | None]:
    return {
        (record.strategy, record.seed): record.result.digest if record.result else record.failure
        for record in store.load_store(folder).records()
    }


@pytest.mark.nightly
@pytest.mark.timeout(240)
def test_a_killed_worker_neither_loses_nor_changes_results(cluster: Cluster, tmp_path: Path) -> None:
    there = tmp_path / "there"
    process = cluster.campaign("--out", str(there))
    while process.poll() is None and not list(there.glob("trials/*.json")):
        time.sleep(0.05)
    os.kill(cluster.workers[0].pid, signal.SIGKILL)
    out, err = process.communicate()
    assert process.returncode == 0, err
    assert '"failed":0' in out
    for (strategy, seed), digest in digests(there).items():
        scenario = load_scenario(CORRIDOR, Overrides(seed=seed, strategy=strategy, settings=SHORT))
        alone = swarm.plan(scenario, RunOptions(tmp_path / str(seed), bus="memory"))
        assert digest == swarm.run_in_memory(alone, lambda progress: None).digest


def test_without_a_configuration_of_dask_the_missing_key_is_named() -> None:
    missing = pytest.raises(ClusterError, match=r"distributed\.comm\.tls\.ca-file in Dask's con")
    with dask.config.set({"distributed.comm.tls.ca-file": None}), missing:
        create_security("tls://127.0.0.1:1", 1.0)


def test_without_tls_a_cluster_is_one_of_this_computer() -> None:
    for address in ("tls://cluster.example-1.org:8786", "tcp://[::1]:8786", "tcp://localhost:1"):
        check_address(address)
    for address in ("tls://nowhere", "ucx://127.0.0.1:8786"):
        with pytest.raises(OptionError, match="must be the address of a scheduler, such"):
            check_address(address)
    for address in ("tcp://0.0.0.0:8786", "tcp://10.0.0.1:1", "tcp://[fe80::1]:1", "tcp://127.0.0.1.a.org:1"):
        assert not is_safe(address)
        with pytest.raises(OptionError, match="must be tls://, except on this computer"):
            check_address(address)


def test_a_scheduler_that_listens_to_all_is_refused_though_reached_on_this_computer() -> None:
    address, workers = "tcp://127.0.0.1:8786", ("tcp://127.0.0.1:4", "tcp://192.168.1.5:8786")
    told = {"address": address, "workers": {key: {"id": 1} for key in workers}}
    client: Any = SimpleNamespace(scheduler_info=lambda n_workers: told)
    with pytest.raises(ClusterError, match=r"listens at tcp://192\.168\.1\.5:8786 without TLS, so anyone"):
        check_tls(client, address)


def serve(listener: socket.socket, keys: Path | None) -> None:
    """Have TLS as a scheduler has it, which asks for a certificate and speaks first; or none."""
    with suppress(OSError):
        plain, _ = listener.accept()
        with plain:
            if keys is None:
                plain.sendall(b"\0" * 16)
                plain.recv(1)
                return
            context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=keys / "cluster.pem")
            context.load_cert_chain(keys / "cluster.pem", keys / "cluster.key")
            context.verify_mode = ssl.CERT_REQUIRED
            with context.wrap_socket(plain, server_side=True) as encrypted:
                encrypted.sendall(b"hello")


def reason(keys: Path, server: Path | None) -> str:
    """Return why a client with these keys cannot connect to a scheduler with those; empty if it can."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve, args=(listener, server), daemon=True)
        thread.start()
        address = f"tls://127.0.0.1:{listener.getsockname()[1]}"
        try:
            tls = yaml.safe_load((keys / "cluster.yaml").read_text())["distributed"]["comm"]["tls"]
            with dask.config.set({f"distributed.comm.tls.{name}": value for name, value in tls.items()}):
                create_security(address, 10.0)
        except ClusterError as error:
            return str(error).removeprefix(f"--on {address}: ")
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            thread.join(10.0)
    return ""


def test_faults_of_a_certificate_are_one_sentence(tmp_path: Path) -> None:
    own, other = make_key(tmp_path / "own"), make_key(tmp_path / "other")
    page = "(docs/clusters.md)"
    signed = f"must be signed by the ca-file {own / 'cluster.pem'}, and valid now {page}"
    refused = f"the scheduler rejects the certificate {own / 'cluster.pem'}, or has no TLS"
    assert reason(own, own) == ""
    assert (
        reason(own, other)
        == f"the scheduler's certificate is not accepted: self-signed certificate; {signed}"
    )
    assert reason(own, None) == f"{refused}: wrong version number {page}"
    mixed = tmp_path / "mixed"  # takes the scheduler's word, and has another key of its own
    mixed.mkdir()
    configure(mixed, other / "cluster.pem", own / "cluster.pem", own / "cluster.key")
    assert reason(mixed, other) == f"{refused}: tlsv1 alert unknown ca {page}"
    configure(mixed, own / "cluster.pem", own / "cluster.pem", other / "cluster.key")
    assert "cannot be used as authority, certificate and its key: " in reason(mixed, own)
    configure(mixed, own / "cluster.pem", own / "cluster.pem", mixed / "nothing")
    assert f"client.key in Dask's configuration is {mixed / 'nothing'}, which is not a file" in reason(
        mixed, own
    )


def test_answers_of_a_worker_are_validated_and_bounded() -> None:
    good = TrialOutcome(b"{}", "cause", b"said")
    assert validated_answer(good) == good
    wrong: list[Any] = [{"record": b""}, None, ("text", "", b"", ""), (None, 3, b"", ""), (None, "", "x", "")]
    for each in (*wrong, *(TrialOutcome(*one) for one in wrong[2:])):
        assert validated_answer(each) == TrialOutcome(None, "invalid answer of a worker", b"")
    large = validated_answer(TrialOutcome(bytes(MAX_BYTES + 1), "", b""))
    assert large.record is None and large.cause == f"answer of a worker exceeds {MAX_BYTES} octets"
    noisy = validated_answer(TrialOutcome(None, "\x1b[2J" + "x" * 9999, b"y" * (2 << 20), "z" * 9999))
    assert len(noisy.cause) < 2000 and "\x1b" not in noisy.cause and len(noisy.refusal) == 500
    assert len(noisy.output) == 1 << 20
