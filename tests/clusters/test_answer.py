"""Whoever waits for a worker learns what keeps it."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys, threading, time
from distributed import Client, Event
from deploy.clusters import connection
from deploy.clusters.connection import ClusterError
from deploy.clusters.connection import answer

def late():
    raise TimeoutError("of its own")

connection._LOOK_S = 0.1
with Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
    (worker,) = client.nthreads()
    sys.stdout.write(worker + chr(10))
    free = Event("free", client=client)
    before = client.submit(lambda: Event("free").wait(60.0), workers=[worker], pure=False)
    while before.key not in client.processing([worker])[worker]:
        time.sleep(0.01)
    threading.Timer(1.0, free.set).start()
    print(answer(client, "inproc", worker, client.submit(divmod, 7, 3, workers=[worker], pure=False)))
    try:
        answer(client, "inproc", worker, client.submit(late, workers=[worker], pure=False))
    except TimeoutError as error:
        print(error)
    left = "inproc://nobody/1/1"
    try:
        answer(client, "inproc", left, client.submit(divmod, 7, 3, workers=[left], pure=False))
    except ClusterError as error:
        print(error)
    connection._LOOK_S = 60.0
    late = client.submit(lambda: Event("never").wait(1.0), workers=[worker], pure=False)
    threading.Timer(0.3, late.cancel).start()  # as the library does with all of them without a scheduler
    try:
        answer(client, "inproc", worker, late)
    except ClusterError as error:
        print(error)
"""
"""A process of its own: a cluster within one leaves threads behind, and tests fork."""


@pytest.mark.nightly
def test_a_worker_is_waited_for_while_it_is_there_and_whoever_waits_is_told_once() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    worker, answered, raised, left, lost = done.stdout.splitlines()
    busy = "it is busy, as with another run or a campaign"
    assert answered == "(2, 1)"
    assert f"acrc: --on inproc: waiting for the worker {worker}; {busy}" in done.stderr.splitlines()
    assert done.stderr.count(f"waiting for the worker {worker}") == 1
    assert raised == "of its own"
    assert left.startswith("--on inproc: the worker inproc://nobody/1/1 has left the cluster (")
    assert lost.startswith("--on inproc: the scheduler does not answer any more (")
