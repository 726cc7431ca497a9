"""`python -m benchmarks.hosts.relay HOST:PORT TARGET_HOST:PORT [--delay-ms MS]`: a slow or broken link.

Passes TCP connections on. Each byte arrives later by the delay, in both directions, at any throughput;
making a connection takes no longer. "ready HOST:PORT" on standard output says where it listens. Each line
on standard input is an order, answered by "ok" or by what is wrong with it:

    delay MS   from now on, for what is sent from now on
    stall      nothing passes, and no connection is made; senders wait
    refuse     connections are refused; those that there are stay
    cut        all connections end with a reset (RST)
    go         the end of stall and refuse

It ends with standard input.
"""

import ipaddress
import math
import os
import resource
import sys
from collections.abc import Callable, Sequence
from typing import Final

from actors.runtime.command_line import ArgumentError, ArgumentParser
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle import linux
from benchmarks.hosts.tcp_relay import Address, TcpRelay

LONGEST_MS: Final = 60_000.0
_PR_SET_TIMERSLACK: Final = 29


def obey(relay: TcpRelay, line: str) -> str:
    """Carry out an order; the answer."""
    orders = {"stall": relay.stall, "refuse": relay.refuse, "cut": relay.cut, "go": relay.go}
    try:
        match line.split():
            case ["delay", number]:
                relay.set_delay(_delay_s(number))
            case [word] if word in orders:
                orders[word]()
            case _:
                return f"order: {line!r}; must be delay MS, stall, refuse, cut or go"
    except AcrcError as error:
        return str(error)
    return "ok"


def _delay_s(number: str) -> float:
    try:
        delay_ms = float(number)
    except ValueError:
        delay_ms = math.nan
    if not 0 <= delay_ms <= LONGEST_MS:
        raise ArgumentError(f"delay: {number}; must be 0 to {LONGEST_MS:.0f} ms")
    return delay_ms / 1000.0


def _address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    try:
        ipaddress.IPv4Address(host)
        number = int(port)
    except ValueError:
        number = -1
    if not 0 <= number < 65536:
        raise ArgumentError(f"address: {text}; must be HOST:PORT, such as 10.77.0.1:8786")
    return host, number


def _obey_input(relay: TcpRelay, ended: list[bool]) -> Callable[[int], None]:
    """What reads orders from standard input, and notes its end."""
    waiting = bytearray()

    def read(_: int) -> None:
        data = os.read(0, 4096)
        if not data:
            ended.append(True)
        waiting.extend(data)
        *lines, rest = waiting.split(b"\n")
        waiting[:] = rest
        for line in lines:
            sys.stdout.write(f"{obey(relay, line.decode('utf-8', 'replace'))}\n")
        sys.stdout.flush()

    return read


def main(argv: Sequence[str]) -> int:
    """Relay until standard input ends; the exit code."""
    parser = ArgumentParser(prog="python -m benchmarks.hosts.relay", description="A slow or broken link.")
    parser.add_argument("listen", help="HOST:PORT; port 0: any that is free")
    parser.add_argument("target", help="HOST:PORT")
    parser.add_argument("--delay-ms", default="0", help="delay each byte by so many ms  [default: 0]")
    ended: list[bool] = []
    try:
        given = parser.parse_args(argv)
        relay = TcpRelay(_address(given.listen), _address(given.target), _delay_s(given.delay_ms))
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    linux.prctl(_PR_SET_TIMERSLACK, 1)  # ns; by itself the system may wake a process 50 µs late
    relay.add_input(0, _obey_input(relay, ended))
    sys.stdout.write(f"ready {relay.address[0]}:{relay.address[1]}\n")
    sys.stdout.flush()
    while not ended:
        relay.step()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
