"""A scenario as the text of a TOML file, and what of it goes onto a robot's disk."""

from actors.robot.stack import TABLES
from actors.table import Table
from deploy.scenario.tables import Scenario
from deploy.scenario.toml_text import document


def to_toml(scenario: Scenario) -> str:
    """The scenario file's text, which reads back as the very same scenario; what is absent stays absent."""
    return document(scenario.model_dump(exclude_none=True))


def adaptation(settled: Table) -> str:
    """The text of every robot's adaptation.toml, of a fleet, or a scenario that leaves nothing to draw."""
    content = settled.model_dump(include={"strategy", "deeco", "area"})
    return "# What the robot's strategy is told, and how it exchanges knowledge.\n\n" + document(content)


def navigation(settled: Table) -> str:
    """The text of every robot's navigation.toml, of a fleet or a scenario."""
    content = settled.model_dump(include=set(TABLES))
    return "# How the robot localises and navigates; what is absent is as in the presets.\n\n" + document(
        content
    )
