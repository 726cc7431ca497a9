"""Whether the accounting of a run's time names what was planted in it, and invents nothing."""
