"""A scenario as the text of a TOML file, and what of it goes onto a robot's disk."""

from deploy.kinds import Table
from deploy.scenario import Scenario
from deploy.toml_text import document


def to_toml(scenario: Scenario) -> str:
    """The scenario file's text, which reads back as the very same scenario; what is absent stays absent."""
    return document(scenario.model_dump(exclude_none=True))


def adaptation(settled: Table) -> str:
    """The text of every robot's adaptation.toml, of a fleet, or a scenario that leaves nothing to draw."""
    content = settled.model_dump(include={"strategy", "deeco", "area"})
    return "# What the robot's strategy is told, and how it exchanges knowledge.\n\n" + document(content)
