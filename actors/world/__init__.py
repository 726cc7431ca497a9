"""Bodies, floor plan, sensing and the conductor of simulated time."""
