"""Scenarios and their errors, from texts."""

from pathlib import Path

from actors.runtime.errors import AcrcError
from deploy.scenario.scenario_file import Overrides, parse
from deploy.scenario.tables import Scenario

FILE = Path("some.toml")
MAP = 'map = "maps/corridor.yaml"\n'

AS_IT_IS = Overrides()


def scenario(text: str, overrides: Overrides = AS_IT_IS, head: str = MAP) -> Scenario:
    """Return the scenario of the text after a map line, with paths relative to the repository."""
    return parse(head + text, Path(__file__).parents[2] / "some.toml", overrides)


def fault(text: str, overrides: Overrides = AS_IT_IS, head: str = MAP) -> str:
    try:
        parse(head + text, FILE, overrides)
    except AcrcError as error:
        return str(error)
    return "nothing was wrong"
