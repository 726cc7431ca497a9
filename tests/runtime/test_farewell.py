"""Closing a session whose links are blocked or broken."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

PROGRAM = """
import sys
import zenoh
from actors.runtime.isolation.rules import session_config, set_value
from actors.runtime.zenoh_bus import open_session

mode, way, endpoint, key = sys.argv[1:]
config = session_config(mode)
set_value(config, "listen/endpoints", [])
set_value(config, f"{way}/endpoints", [endpoint])
with open_session(config, 5.0) as session:
    subscriber = session.declare_subscriber(key, lambda sample: None)
    print("up", flush=True)
    told = sys.stdin.readline().split()
    for _ in told:
        session.put(told[0], bytes(60_000), congestion_control=zenoh.CongestionControl.BLOCK)
"""
ENOUGH = 400
"""Messages that fill every buffer between two sessions."""


@contextmanager
def session(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Start a process with a session; `words`: mode, listen or connect, address, subscription."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "up\n"
            yield process
        finally:
            process.kill()


def tell(process: subprocess.Popen[str], text: str) -> None:
    assert process.stdin is not None
    process.stdin.write(f"{text}\n")
    process.stdin.flush()


@pytest.mark.nightly
def test_router_closes_with_a_blocked_link_and_broken_links(tmp_path: Path) -> None:
    socket = f"unixsock-stream/{tmp_path}/s"
    with ExitStack() as stack:
        router = stack.enter_context(session("router", "listen", socket, "own"))
        stopped = stack.enter_context(session("router", "connect", socket, "down/**"))
        sender, quiet = (
            stack.enter_context(session("client", "connect", socket, f"down/{name}")) for name in "ab"
        )
        os.kill(stopped.pid, signal.SIGSTOP)
        tell(sender, "down/x " * ENOUGH)
        time.sleep(1.0)
        sender.kill()
        quiet.kill()
        time.sleep(0.2)
        tell(router, "")
        assert router.wait(timeout=8.0) == 0
