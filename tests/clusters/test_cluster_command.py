"""`acrc cluster`: a scheduler and a worker that are started by two commands."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from distributed import Client

from actors.runtime.lifecycle import process_table
from tests.hosts.test_hosted_runs import eventually
from tests.in_process import acrc

ROOT = Path(__file__).parents[2]


def begun(folder: Path, name: str, *words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-P", "-m", "command_line", "cluster", *words]
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log, start_new_session=True)


def ended(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGINT)
    process.wait(timeout=30)


@pytest.mark.timeout(120)
def test_two_commands_make_a_cluster_that_ends_with_them(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    scheduler = begun(tmp_path, "scheduler", "start", address)
    worker = begun(tmp_path, "worker", "join", address, "--workers", "2")
    try:
        with Client(address, timeout=60) as client:
            client.wait_for_workers(2, timeout=60)
            assert [*client.nthreads().values()] == [1, 1]
            assert client.submit(os.getpid).result() != os.getpid()
    finally:
        ended(worker)
        ended(scheduler)
    ours = {worker.pid, scheduler.pid}
    assert eventually(lambda: not any(one.session in ours for one in process_table.table().values()))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("start", "here"),
            "acrc: ADDRESS: here; must be the address of a scheduler, such as tls://192.168.1.5:8786",
        ),
        (
            ("join", "tcp://192.168.1.5:8786"),
            "acrc: ADDRESS: tcp://192.168.1.5:8786; must be tls:// anywhere but on this computer, for "
            "without TLS a cluster runs whatever comes from whoever reaches it (docs/clusters.md)",
        ),
    ],
)
def test_what_is_no_address_of_use_is_a_sentence(words: tuple[str, ...], said: str) -> None:
    done = acrc("cluster", *words)
    assert (done.returncode, done.stderr.strip()) == (2, said)
