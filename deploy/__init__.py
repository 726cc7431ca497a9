"""Scenario, swarm and command line: whatever stands around the actors of a run."""
