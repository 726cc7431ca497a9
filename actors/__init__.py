"""The actors of a swarm: one world, one radio, one process per robot, and optional observers."""
