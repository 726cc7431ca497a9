"""A strategy of one's own is one file in the folder where one stands."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.swarm.command import ROOT

OWN = """
from actors.instant import Instant
from actors.robot.ports import Behaviour, Decision, Start, View

class Lazy:
    def advance(self, view: View, until: Instant) -> Decision:
        return Decision(tasks_left=0)

def behaviour(start: Start) -> Behaviour:
    return Lazy()
"""


@pytest.mark.parametrize("words", [["--isolate"], ["--no-isolate"], ["--bus", "memory"]], ids=" ".join)
def test_a_file_in_the_working_directory(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "my_study").mkdir()
    (tmp_path / "my_study" / "lazy.py").write_text(OWN)
    command = "import sys; sys.path[0] = sys.argv.pop(1); from deploy.cli import main; main()"
    done = subprocess.run(
        [
            *(sys.executable, "-c", command, str(ROOT), "run", "--strategy", "my_study.lazy:behaviour"),
            *("--out", "out", "--json", *words),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["simulated_s"] == 0.1  # everybody says at once that nothing is left to do
