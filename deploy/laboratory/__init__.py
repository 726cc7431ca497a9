"""Runs with emulated devices: the processes as on board, on serial bytes only."""
