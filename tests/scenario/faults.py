"""Scenario texts for the tests."""

from pathlib import Path

from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import Overrides, parse
from deploy.scenario.tables import Scenario

FILE = Path("some.toml")
MAP = 'map = "maps/corridor.yaml"\n'

AS_IT_IS = Overrides()


def scenario(text: str, overrides: Overrides = AS_IT_IS, head: str = MAP) -> Scenario:
    """The scenario with the text behind the line that names the map, as if it lay beside the maps."""
    return parse(head + text, Path(__file__).parents[2] / "some.toml", overrides)


def fault(text: str, overrides: Overrides = AS_IT_IS, head: str = MAP) -> str:
    try:
        parse(head + text, FILE, overrides)
    except AcrcError as error:
        return str(error)
    return "nothing was wrong"
