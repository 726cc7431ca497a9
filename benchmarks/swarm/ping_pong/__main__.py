"""One process of the ping-pong: `python -m benchmarks.swarm.ping_pong conductor|robot --robots N …`."""

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import zenoh

from actors.runtime.command_line import ArgumentParser

PAYLOAD = bytes(100)
STOP = b"stop"


def main(argv: Sequence[str]) -> int:
    """Play one side; the exit code."""
    parser = ArgumentParser(prog="python -m benchmarks.swarm.ping_pong")
    parser.add_argument("side", choices=("conductor", "robot"))
    parser.add_argument("--robots", type=int, default=1)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--number", type=int, default=0)
    parser.add_argument("--socket", type=Path, required=True)
    parser.add_argument("--result", type=Path, required=True)
    given = parser.parse_args(argv)
    if given.side == "conductor":
        figures = _conduct(given.socket, given.robots, given.steps)
    else:
        figures = _answer(given.socket, given.number)
    given.result.write_text(json.dumps(figures))
    return 0


def _conduct(socket: Path, robots: int, steps: int) -> dict[str, float]:
    """Ask everyone and wait for all, so many times; seconds of wall clock and CPU of the steps alone."""
    config = _config("router")
    unnamed = socket.with_suffix(".new")
    config.insert_json5("listen/endpoints", json.dumps([f"unixsock-stream/{unnamed}"]))
    config.insert_json5("scouting/delay", "0")
    with zenoh.open(config) as session:
        answers = session.declare_subscriber("pong/*", zenoh.handlers.FifoChannel(4096))
        unnamed.rename(socket)  # nobody may come before the subscription stands
        for _ in range(robots):
            answers.recv()  # each says once that it is there
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(steps):
            for number in range(robots):
                session.put(f"ping/{number}", PAYLOAD, congestion_control=zenoh.CongestionControl.BLOCK)
            for _ in range(robots):
                answers.recv().payload.to_bytes()
        figures = {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
        for number in range(robots):
            session.put(f"ping/{number}", STOP, congestion_control=zenoh.CongestionControl.BLOCK)
        time.sleep(0.2)  # the session's end would overtake the last messages
    return figures


def _answer(socket: Path, number: int) -> dict[str, float]:
    """Answer until told to stop; seconds of CPU between the first question and the last."""
    config = _config("client")
    config.insert_json5("connect/endpoints", json.dumps([f"unixsock-stream/{socket}"]))
    with _joined(config) as session:
        questions = session.declare_subscriber(f"ping/{number}", zenoh.handlers.FifoChannel(4096))
        key = f"pong/{number}"
        session.put(key, PAYLOAD, congestion_control=zenoh.CongestionControl.BLOCK)
        cpu = time.process_time()
        while questions.recv().payload.to_bytes() != STOP:
            session.put(key, PAYLOAD, congestion_control=zenoh.CongestionControl.BLOCK)
        return {"cpu_s": time.process_time() - cpu}


def _joined(config: zenoh.Config) -> zenoh.Session:
    deadline = time.monotonic() + 30
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.01)


def _config(mode: str) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
