"""What a robot is told about its adaptation: the strategy's settings, the exchange of knowledge, areas."""

import msgspec

from actors.floor.placement import Area
from actors.robot.behaviour.ports import ExchangeSettings, Setting


class Adaptation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As the tables of a scenario or of a fleet say it (`deploy.scenario.stack_tables`)."""

    settings: dict[str, Setting] = {}
    """The strategy's, by name; what they are, the strategy says itself (`cleaning.settings`)."""
    exchange: ExchangeSettings = ExchangeSettings()
    areas: tuple[Area, ...] = ()
    """Where places lie; none: anywhere."""
