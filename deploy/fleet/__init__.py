"""Robots made of computers: the fleet file, keys, services, their processes, and the operator's watch."""
