"""What systemd is told, on sockets of both kinds."""

import os
import socket
from pathlib import Path

import pytest

from deploy.fleet.onboard_run import ServiceNotice


@pytest.mark.parametrize("abstract", [False, True])
def test_systemd_hears_that_a_service_is_up_and_lives(tmp_path: Path, abstract: bool) -> None:
    name = f"acrc-test-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(f"\0{name}" if abstract else name)
        systemd.settimeout(10)
        notice = ServiceNotice({"NOTIFY_SOCKET": f"@{name}" if abstract else name})
        notice.ready()
        notice.lives()
        assert [systemd.recv(100), systemd.recv(100)] == [b"READY=1", b"WATCHDOG=1"]
    notice.lives()  # nobody listens any more


def test_elsewhere_nothing_happens() -> None:
    for environment in ({}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "nonsense"}):
        ServiceNotice(environment).lives()
