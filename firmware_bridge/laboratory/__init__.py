"""Laboratory: real-time emulation of a swarm's hardware, with bodies in the simulated world."""
