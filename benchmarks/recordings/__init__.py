"""Recordings of a whole swarm: what they cost, how large they get, how fast a robot is replayed."""
