"""How a robot gets somewhere: goals, global planning, the local cost map, the local planner."""
