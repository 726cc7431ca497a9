"""Whole swarms: speed, CPU time by part, seeds, crowded starts and violent ends."""
