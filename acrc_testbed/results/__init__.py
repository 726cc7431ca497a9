"""What a run comes to: its result, gathered from the last records of its processes."""
