"""Results of runs, computed from the final records of their processes."""
