"""Localisation: dead reckoning, and a particle filter on the floor plan."""

from typing import Final

from actors.robot.localisation import confidence, measurement, motion, resampling
from actors.robot.localisation.amcl import Amcl
from actors.robot.localisation.likelihood_field import LikelihoodField, likelihood_field
from actors.robot.localisation.parameters import (
    PRESETS,
    AmclParameters,
    DeadReckoning,
    Estimate,
    Localisation,
)

KERNELS: Final = (measurement, confidence, resampling, motion)
"""Modules with numeric kernels."""

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
