"""Where the robot is: dead reckoning, and a particle filter on the floor plan."""

from typing import Final

from actors.robot.localisation import (
    beams,
    confidence,
    evidence,
    histogram,
    line_of_sight,
    measurement,
    motion,
    resampling,
)
from actors.robot.localisation.amcl import Amcl
from actors.robot.localisation.dead_reckoning import DeadReckoning
from actors.robot.localisation.estimate import Estimate, Localisation
from actors.robot.localisation.likelihood_field import LikelihoodField, likelihood_field
from actors.robot.localisation.parameters import PRESETS, AmclParameters

KERNELS: Final = (
    beams,
    line_of_sight,
    evidence,
    confidence,
    histogram,
    measurement,
    motion,
    resampling,
)
"""The modules with numeric kernels."""

__all__ = [
    "KERNELS",
    "PRESETS",
    "Amcl",
    "AmclParameters",
    "DeadReckoning",
    "Estimate",
    "LikelihoodField",
    "Localisation",
    "likelihood_field",
]
