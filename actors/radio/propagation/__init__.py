"""How much of a signal arrives: path loss, walls and their materials, shadowing; and what interferes."""

from actors.radio.propagation.indoor import IndoorPropagation, PropagationParameters

__all__ = ["IndoorPropagation", "PropagationParameters"]
