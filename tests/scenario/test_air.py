"""From the tables of the air to what the radio is told."""

from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.radio.propagation.interferers import WifiParameters
from actors.radio.propagation.walls import WallPatch
from actors.runtime.errors import AcrcError
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import load_scenario, parse
from deploy.scenario.toml_text import to_toml
from tests.scenario.faults import scenario

TABLES = """
[robots]
count = 2
[radio]
preset = "beeclick"
channel = 15
walls = "concrete"
shadowing_db = 4.0
correlation_distance = 1.5
[[wall]]
material = "glass"
x = [11.0, 14.0]
y = [0.0, 7.0]
[[wifi]]
at = [15, 12]
channel = 6
duty = 0.3
"""


def test_the_radio_is_told_what_the_tables_say() -> None:
    told = resolve(scenario(TABLES)).radio
    assert (told.preset, told.channel, told.walls) == ("beeclick", 15, "concrete")
    assert (told.shadowing_db, told.correlation_distance) == (4.0, 1.5)
    assert told.patches == (WallPatch("glass", (11.0, 14.0), (0.0, 7.0)),)
    assert told.wifi == (WifiParameters(15.0, 12.0, 6, 0.3),)
    assert Path(told.map).name == "corridor.yaml"


def test_what_the_tables_leave_out_is_left_to_the_preset() -> None:
    told = resolve(load_scenario(REPOSITORY / "scenarios" / "corridor.toml")).radio
    assert (told.walls, told.shadowing_db, told.correlation_distance, told.channel) == (None,) * 4
    assert not told.patches and not told.wifi


def test_the_tables_read_back_from_the_text_of_a_settled_scenario() -> None:
    settled = resolve(scenario(TABLES)).scenario
    text = to_toml(settled)
    assert resolve(parse(text, Path("settled.toml"))).radio == resolve(scenario(TABLES)).radio


def test_a_wall_where_there_is_none_is_refused() -> None:
    with pytest.raises(AcrcError) as caught:
        resolve(scenario('[[wall]]\nmaterial = "glass"\nx = [12.0, 12.5]\ny = [5.0, 5.5]'))
    assert str(caught.value) == (
        "wall[0] spans x 12 to 12.5 and y 5 to 5.5 m, where nothing is occupied, but must hold a wall"
    )
