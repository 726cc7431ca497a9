"""Own orders, nearest first; the nearest charger when the battery is nearly empty.

Idea: baseline. Source: nearest neighbour dispatching. Limits: robots do not communicate; several wait at one
charger while another one is free, and two that meet in a narrow passage may stand until the end. Settings:
`DeliveryParameters`.
"""

from actors.robot.behaviour import Behaviour, Start, from_settings, host
from logistics.robot import DeliveryParameters, DeliveryRobot


def behaviour(start: Start) -> Behaviour:
    """Carry the robot's own orders, nearest first; charge when nearly empty, at the nearest charger."""
    return host(start, DeliveryRobot.at_start(start, from_settings(DeliveryParameters, start.settings)))
