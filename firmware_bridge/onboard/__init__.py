"""Processes of a physical robot that surround the robot program of the simulation: base and bridge."""
