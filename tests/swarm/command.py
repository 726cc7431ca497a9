"""Commands of tests, and processes and files that a run leaves behind."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests import in_process, warm

ROOT = Path(__file__).resolve().parents[2]
MODULE_PATH = os.environ.get("PYTHONPATH")
ACRC = (sys.executable, "-m", "acrc_testbed.command_line")


def acrc(*words: object, timeout_s: float = 100.0) -> subprocess.CompletedProcess[str]:
    """Run `acrc WORDS…`: in a fork for runs over Zenoh and orders to robots (which exit), else in process."""
    over_mesh = words[0] == "run" and "memory" not in words
    ends_process = words[0] == "fleet" and words[1] in {"stop", "pause", "resume"}
    if not over_mesh and not ends_process and os.environ.get("PYTHONPATH") == MODULE_PATH:
        return in_process.acrc(*words)
    return warm.run([*map(str, words)], ROOT, os.environ, timeout_s, finds_cwd=True)


def run(out: Path, *words: object) -> dict[str, Any]:
    """Return the result of `acrc run WORDS… --out OUT --json`, which must succeed and print nothing else."""
    done = acrc("run", *words, "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def begin(*words: object) -> warm.ForkedCommand:
    return warm.begin([*map(str, words)], ROOT, os.environ, finds_cwd=True)


def start(*words: object) -> subprocess.Popen[str]:
    """Start a command in a new interpreter, for tests of start and exit."""
    return subprocess.Popen(
        [*ACRC, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    )


def processes_of(out: Path) -> list[int]:
    """Return the ids of live processes with a run's folder in their command line or log path."""
    return sorted(set(_holders(str(out))))


def leftovers(out: Path) -> list[Path]:
    """Return sockets, locks and credentials in a run's folder."""
    return sorted(
        path
        for path in out.rglob("*")
        if path.is_socket() or "credentials" in path.name or path.suffix == ".lock" or path.name == "users"
    )


def _holders(out: str) -> Iterator[int]:
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        try:
            command = (entry / "cmdline").read_bytes().decode(errors="replace")
            log = str((entry / "fd" / "1").readlink())
            state = (entry / "stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            continue
        if state != "Z" and (out in command or out in log):
            yield int(entry.name)
