"""Start, monitoring and exit of a run's processes."""
