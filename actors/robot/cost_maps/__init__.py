"""What stands around a robot, and what it costs to be near it."""
