"""A strategy of one's own is one file in the folder where one stands."""

import json
import os
from pathlib import Path

import pytest

from tests import warm

OWN = """
from actors.instant import Instant
from actors.messages import PlaceGivenUp, PlaceKey
from actors.robot.behaviour import Behaviour, Decision, Start, View

class Lazy:
    def __init__(self, start: Start) -> None:
        self.robot, self.places = start.robot, len(start.places)

    def advance(self, view: View, until: Instant) -> Decision:
        keys = tuple(PlaceKey(self.robot, place) for place in range(self.places))
        given_up = tuple(PlaceGivenUp(k.owner, k.place, view.instant, "too lazy") for k in keys)
        return Decision(given_up=given_up, route=())

def behaviour(start: Start) -> Behaviour:
    return Lazy(start)
"""


@pytest.mark.parametrize("words", [["--isolate"], ["--no-isolate"], ["--bus", "memory"]], ids=" ".join)
def test_a_file_in_the_working_directory(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "my_study").mkdir()
    (tmp_path / "my_study" / "lazy.py").write_text(OWN)
    asked = ["run", "--strategy", "my_study.lazy:behaviour", "--out", "out", "--json", *words]
    done = warm.run(asked, tmp_path, os.environ, 100.0, finds_cwd=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["simulated_s"] == 0.1  # everybody gives everything up at once
