"""Sockets and programs of a test on a host."""

import ctypes
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.hosts.host import RigHost

CLONE_NEWNET = 0x4000_0000
PATIENCE = 10.0
KINDS = ("uts", "net", "mnt")
"""Of the namespaces that a host has of its own."""


def eventually(holds: Callable[[], object]) -> bool:
    deadline = time.monotonic() + PATIENCE
    while not holds():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.01)
    return True


def socket_on(host: RigHost, kind: int = socket.SOCK_STREAM) -> socket.socket:
    """A socket of this process in the network of the host, where it stays; it waits at most PATIENCE."""
    made: list[socket.socket] = []

    def make() -> None:
        network = os.open(f"/proc/{host.holder}/ns/net", os.O_RDONLY)
        try:
            if ctypes.CDLL(None, use_errno=True).setns(network, CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), "setns")
            made.append(socket.socket(type=kind))
        finally:
            os.close(network)

    thread = threading.Thread(target=make)  # a network is a thread's own
    thread.start()
    thread.join()
    made[0].settimeout(PATIENCE)
    return made[0]


def listening_on(host: RigHost, address: tuple[str, int]) -> socket.socket:
    one = socket_on(host)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    one.bind(address)
    one.listen()
    return one


def connected_from(host: RigHost, address: tuple[str, int]) -> socket.socket:
    one = socket_on(host)
    try:
        one.connect(address)
    except BaseException:
        one.close()
        raise
    return one


def python_on(host: RigHost, code: str, *words: str) -> str:
    """What the code says, run on the host."""
    done = subprocess.run(
        host.command([sys.executable, "-c", code, *words]),
        capture_output=True,
        text=True,
        check=True,
        timeout=60.0,
    )
    return done.stdout.strip()


def alive_in(rooms: set[str]) -> list[int]:
    """The processes in these namespaces, of whatever kind."""
    found = []
    for kind in KINDS:
        for path in Path("/proc").glob(f"[0-9]*/ns/{kind}"):
            try:
                if str(path.readlink()) in rooms:
                    found.append(int(path.parts[2]))
            except OSError:
                continue
    return found
