"""The ping-pong's processes: started, waited for, and what they took."""

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from actors.installation.repository import REPOSITORY


@dataclass(frozen=True)
class PingPong:
    """What one of its steps takes."""

    wall_us: float
    cpu_us: float
    """Of all processes, per robot."""


def played(robots: int, steps: int) -> PingPong:
    """So many steps: 100 bytes to each process and back."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        place = Path(folder)

        def player(*words: object) -> subprocess.Popen[bytes]:
            name = "-".join(map(str, words))
            return subprocess.Popen(
                [
                    *(sys.executable, "-m", "benchmarks.swarm.ping_pong", *map(str, words)),
                    *("--socket", str(place / "s"), "--result", str(place / f"{name}.json")),
                ],
                cwd=REPOSITORY,
            )

        players = [player("conductor", "--robots", robots, "--steps", steps)]
        players += [player("robot", "--number", number) for number in range(robots)]
        for process in players:
            if process.wait(timeout=300):
                raise RuntimeError(f"a player of the ping-pong ended with exit code {process.returncode}")
        results = [json.loads(path.read_text()) for path in place.glob("*.json")]
    wall = next(result["wall_s"] for result in results if "wall_s" in result)
    return PingPong(wall / steps * 1e6, sum(result["cpu_s"] for result in results) / robots / steps * 1e6)
