"""Emulated boards: the firmware's side of the wire, on the simulated medium."""
