"""Recordings of a swarm: cost, size, how fast a robot is replayed, and what their seal finds."""
