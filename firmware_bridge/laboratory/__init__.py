"""Plays the hardware of a swarm: bodies in the simulated world behind emulated devices, in real time."""
