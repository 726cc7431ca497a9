"""Cluster scripts for ssh, Slurm and Kubernetes, run with stand-ins and compared with the image."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
from distributed import Client, Security

from actors.runtime import process_table
from tests.experiments.test_cluster import ROOT, make_key
from tests.helpers import free_port
from tests.hosts.test_hosted_runs import eventually
from tests.in_process import acrc
from tests.swarm.command import ACRC

FILES = ROOT / "deploy" / "clusters"
PAGE = (ROOT / "docs" / "clusters.md").read_text()
STAND_INS = {
    "ssh": '#!/bin/sh\necho "$1 $2" >>"$SAID"\nshift 2\nexec sh -c "$*"\n',
    "nproc": "#!/bin/sh\necho 1\n",
    "srun": '#!/bin/sh\n"$@" & "$@" & wait\n',
    "hostname": "#!/bin/sh\necho 127.0.0.1\n",
}
"""Stand-ins of programs, by name: remote computers are this one, with one core."""
SBATCH = {
    "job-name": r"\w+", "nodes": r"\d+", "ntasks-per-node": "1", "cpus-per-task": r"\d+",
    "mem-per-cpu": r"\d+[MG]", "time": r"(\d+-)?\d\d:\d\d:\d\d", "output": r"[\w-]+%j\.log",
}  # fmt: skip
"""Options of sbatch(1) with patterns of their values."""


@contextmanager
def begun(folder: Path, words: list[str], **variables: str) -> Iterator[subprocess.Popen[str]]:
    """Run a script in its own session, with keys and stand-ins; kill leftover processes."""
    (folder / "bin").mkdir()
    for name, text in STAND_INS.items():
        (folder / "bin" / name).write_text(text)
        (folder / "bin" / name).chmod(0o755)
    environment = os.environ | variables | {
        "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
        "SAID": str(folder / "said"),
        "DASK_CONFIG": str(make_key(folder / "keys")),
    }  # fmt: skip
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            words, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, text=True,
            start_new_session=True,
        )  # fmt: skip
    try:
        yield process
    finally:
        for group in members(process.pid):
            os.kill(group, signal.SIGKILL)
        process.wait()


def members(session: int) -> list[int]:
    """Return the running processes of a session."""
    listed = subprocess.run(
        ["ps", "-o", "pid=,stat=", "-s", str(session)], capture_output=True, text=True, check=False
    ).stdout
    return [int(line.split()[0]) for line in listed.splitlines() if not line.split()[1].startswith("Z")]


def connect(keys: Path, address: str) -> Client:
    """Connect with these keys as soon as a scheduler answers."""
    pem, key = str(keys / "cluster.pem"), str(keys / "cluster.key")
    security = Security(tls_ca_file=pem, tls_client_cert=pem, tls_client_key=key, require_encryption=True)
    for _ in range(600):
        try:
            return Client(address, timeout=1.0, security=security)
        except OSError:
            time.sleep(0.1)
    raise AssertionError(f"no scheduler at {address}")


@pytest.mark.nightly
@pytest.mark.timeout(240)
def test_over_ssh_each_host_has_workers_until_the_script_ends(tmp_path: Path) -> None:
    port = free_port()
    words = [str(FILES / "ssh.sh"), f"127.0.0.1:{port}", "lab1", "lab2"]
    with begun(tmp_path, words) as script:
        with connect(tmp_path / "keys", f"tls://127.0.0.1:{port}") as client:
            client.wait_for_workers(2, timeout=100)
            assert set(client.nthreads().values()) == {1}
        assert sorted((tmp_path / "said").read_text().splitlines()) == ["-tt lab1", "-tt lab2"]
        script.send_signal(signal.SIGTERM)
        assert script.wait(30) == 130
        deadline = time.monotonic() + 60
        while (left := members(script.pid)) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert left == []


def test_ssh_without_an_address_is_one_sentence() -> None:
    words = ["lab1", "lab2"]
    done = subprocess.run([FILES / "ssh.sh", *words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"ssh.sh: {' '.join(words)}; must be HERE:PORT HOST..., such as 192.168.1.5:8786 lab1 lab2\n"
    )


@pytest.mark.nightly
@pytest.mark.timeout(240)
def test_a_slurm_job_runs_the_campaign_on_all_nodes_and_cleans_up(tmp_path: Path) -> None:
    campaign = (
        *("campaign", "--strategies", "none", "--seeds", "2", "--robots", "2", "--duration", "1"),
        *("--check-every", "0", "--json", "--out", str(tmp_path / "out")),
    )
    job = {"SLURM_JOB_ID": str(free_port()), "SLURM_JOB_NUM_NODES": "2"}
    job |= {"SLURM_SUBMIT_DIR": str(ROOT), "SLURM_CPUS_PER_TASK": "1"}
    with begun(tmp_path, ["bash", str(FILES / "slurm.sbatch"), *campaign], **job) as script:
        code = script.wait(200)
        said = (tmp_path / "log").read_text()
        assert code == 0, said
        assert '"done":2,"failed":0' in said
        assert said.count("Registered to") == 2


def test_sbatch_options_are_valid_and_precede_commands() -> None:
    lines = (FILES / "slurm.sbatch").read_text().splitlines()
    first = next(number for number, line in enumerate(lines) if line and not line.startswith("#"))
    asked = [line.removeprefix("#SBATCH ") for line in lines[:first] if line.startswith("#SBATCH")]
    assert not any(line.startswith("#SBATCH") for line in lines[first:])
    options = dict(one.removeprefix("--").split("=", 1) for one in asked)
    assert options.keys() == SBATCH.keys()
    assert [name for name, form in SBATCH.items() if not re.fullmatch(form, options[name])] == []


def pods() -> dict[str, dict[str, Any]]:
    """Return the parts of the manifest, by component."""
    whole = yaml.safe_load((FILES / "kubernetes.yaml").read_text())
    assert (whole["apiVersion"], whole["kind"]) == ("kubernetes.dask.org/v1", "DaskCluster")
    spec: dict[str, dict[str, Any]] = whole["spec"]
    assert whole["metadata"] == {"name": "acrc"} and spec.keys() == {"scheduler", "worker"}
    return spec


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["scheduler", "worker"])
def test_kubernetes_pods_match_the_image_and_have_keys(name: str) -> None:
    image, part = (FILES.parent / "container" / "Dockerfile").read_text(), pods()[name]
    (container,) = part["spec"]["containers"]
    python, module, program, *_ = container["command"]
    assert (python, module) == ("/opt/acrc/.venv/bin/python", "-m") and "\nWORKDIR /opt/acrc\n" in image
    assert program == f"distributed.cli.dask_{name}"
    told = subprocess.run(
        [sys.executable, "-m", program, "--help"], capture_output=True, text=True, check=True
    ).stdout
    given = {word.partition("=")[0] for word in container["command"][3:] if word.startswith("--")}
    known = set(re.findall(r"--[\w-]+", told))
    assert given <= known
    user = re.search(r"useradd --uid (\d+) ", image)
    assert user and part["spec"]["securityContext"]["runAsUser"] == int(user[1])
    (volume,) = part["spec"]["volumes"]
    assert volume["secret"]["secretName"] == "acrc-cluster" and "secret generic acrc-cluster " in PAGE
    assert container["volumeMounts"] == [{"name": volume["name"], "mountPath": "/etc/dask", "readOnly": True}]
    rights = container["securityContext"]
    assert rights == {
        "allowPrivilegeEscalation": False,
        "capabilities": {"drop": ["ALL"]},
        "seccompProfile": {"type": "Unconfined"},
    }
    profile = f"container.apparmor.security.beta.kubernetes.io/{container['name']}"
    assert part["metadata"]["annotations"] == {profile: "unconfined"}


def test_kubernetes_workers_find_the_scheduler_and_match_their_cores() -> None:
    scheduler, worker = pods()["scheduler"], pods()["worker"]
    (at,), (working,) = scheduler["spec"]["containers"], worker["spec"]["containers"]
    ports = {one["name"]: one["containerPort"] for one in at["ports"]}
    assert {one["targetPort"]: one["port"] for one in scheduler["service"]["ports"]} == ports
    assert f"--port={ports['tcp-comm']}" in at["command"] and "--protocol=tls" in at["command"]
    assert f"tls://acrc-scheduler:{ports['tcp-comm']}" in working["command"]
    assert f"--nworkers={working['resources']['requests']['cpu']}" in working["command"]
    assert working["resources"]["requests"] == working["resources"]["limits"]


def test_the_adaptive_cluster_of_the_page_uses_tls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """With a stand-in, because dask-jobqueue is not installed here."""
    asked: dict[str, Any] = {}

    class SLURMCluster:
        scheduler_address = "tls://10.0.0.5:8786"

        def __init__(self, **words: Any) -> None:
            asked.update(words)

        def __enter__(self) -> "SLURMCluster":
            return self

        def __exit__(self, *_: object) -> None:
            asked["ended"] = True

        def adapt(self, **words: int) -> None:
            asked.update(words)

    stand_in = ModuleType("dask_jobqueue")
    stand_in.SLURMCluster = SLURMCluster  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "dask_jobqueue", stand_in)
    monkeypatch.setattr("builtins.input", lambda prompt: "")
    block = PAGE.partition("```python\n")[2].partition("```")[0]
    exec(compile(block, "docs/clusters.md", "exec"), {})
    assert asked["protocol"] == "tls://" and asked["security"].require_encryption
    assert asked["cores"] == asked["processes"] and asked["minimum_jobs"] == 1 and asked["ended"]


PROGRAM = """
import sys, threading, time
from distributed import Client, Event
from deploy.hosts import connection
from deploy.hosts.connection import ClusterError
from deploy.hosts.connection import await_result

def late():
    raise TimeoutError("of its own")

connection._CHECK_INTERVAL_S = 0.1
with Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
    (worker,) = client.nthreads()
    sys.stdout.write(worker + chr(10))
    free = Event("free", client=client)
    before = client.submit(lambda: Event("free").wait(60.0), workers=[worker], pure=False)
    while before.key not in client.processing([worker])[worker]:
        time.sleep(0.01)
    threading.Timer(1.0, free.set).start()
    print(await_result(client, "inproc", worker, client.submit(divmod, 7, 3, workers=[worker], pure=False)))
    try:
        await_result(client, "inproc", worker, client.submit(late, workers=[worker], pure=False))
    except TimeoutError as error:
        print(error)
    left = "inproc://nobody/1/1"
    try:
        await_result(client, "inproc", left, client.submit(divmod, 7, 3, workers=[left], pure=False))
    except ClusterError as error:
        print(error)
    connection._CHECK_INTERVAL_S = 60.0
    late = client.submit(lambda: Event("never").wait(1.0), workers=[worker], pure=False)
    threading.Timer(0.3, late.cancel).start()  # as the library does with all of them without a scheduler
    try:
        await_result(client, "inproc", worker, late)
    except ClusterError as error:
        print(error)
"""
"""Program for a separate process: a cluster in this one would leave threads, and tests fork."""


@pytest.mark.nightly
def test_waiting_for_a_worker_is_reported_once() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    worker, answered, raised, left, lost = done.stdout.splitlines()
    busy = "it is busy, as with another run or a campaign"
    assert answered == "(2, 1)"
    assert f"acrc: --on inproc: waiting for the worker {worker}; {busy}" in done.stderr.splitlines()
    assert done.stderr.count(f"waiting for the worker {worker}") == 1
    assert raised == "of its own"
    assert left.startswith("--on inproc: the worker inproc://nobody/1/1 has left the cluster (")
    assert lost.startswith("--on inproc: the scheduler does not answer any more (")


def command(folder: Path, name: str, *words: str) -> subprocess.Popen[bytes]:
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen(
            [*ACRC, "cluster", *words], cwd=ROOT, stdout=log, stderr=log, start_new_session=True
        )


def ended(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGINT)
    process.wait(timeout=30)


@pytest.mark.nightly
@pytest.mark.timeout(120)
def test_two_commands_make_a_cluster_that_ends_with_them(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    scheduler = command(tmp_path, "scheduler", "start", address)
    worker = command(tmp_path, "worker", "join", address, "--workers", "2")
    try:
        with Client(address, timeout=60) as client:
            client.wait_for_workers(2, timeout=60)
            assert [*client.nthreads().values()] == [1, 1]
            assert client.submit(os.getpid).result() != os.getpid()
    finally:
        ended(worker)
        ended(scheduler)
    ours = {worker.pid, scheduler.pid}
    assert eventually(lambda: not any(one.session in ours for one in process_table.processes().values()))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("start", "here"), "here; must be the address of a scheduler, such as tls://192.168.1.5:8786"),
        (("join", "tcp://192.168.1.5:8786"),
         "tcp://192.168.1.5:8786; must be tls://, except on this computer: without TLS anyone who can "
         "connect can execute code (docs/clusters.md)"),
    ],
)  # fmt: skip
def test_unusable_addresses_are_refused(words: tuple[str, ...], said: str) -> None:
    done = acrc("cluster", *words)
    assert (done.returncode, done.stderr.strip()) == (2, f"acrc: ADDRESS: {said}")
