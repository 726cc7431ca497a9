"""Whole swarms: speed, CPU time by part, traffic, relays, crowded starts, campaigns and violent ends."""
