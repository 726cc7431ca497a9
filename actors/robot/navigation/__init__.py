"""How a robot gets somewhere: goals, global planning, the local cost map, the dynamic window approach."""
