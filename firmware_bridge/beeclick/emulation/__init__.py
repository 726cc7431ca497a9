"""Boards that are not there: the firmware's side of the wire, on the simulated medium."""
