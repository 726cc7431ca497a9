"""Some steps of a swarm over Zenoh as a timeline: who works, and who waits for whom."""
