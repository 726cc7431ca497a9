"""A scenario as the text of a TOML file."""

from deploy.scenario.tables import Scenario
from deploy.scenario.toml_text import document


def to_toml(scenario: Scenario) -> str:
    """The scenario file's text, which reads back as the very same scenario; what is absent stays absent."""
    return document(scenario.model_dump(exclude_none=True))
