"""Whole swarms: speed, CPU time by part, seeds, relays, crowded starts and violent ends."""
