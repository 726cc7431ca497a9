"""Whole swarms: speed, CPU time by part, relays, crowded starts, campaigns and violent ends."""
