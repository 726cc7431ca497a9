"""Navigation: goals, recoveries, global and local planning."""
