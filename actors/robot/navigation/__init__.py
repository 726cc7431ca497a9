"""How a robot gets somewhere: goals, recoveries and global planning."""
