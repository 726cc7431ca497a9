"""What a run comes to: gathered from the last records of its processes, and told."""
