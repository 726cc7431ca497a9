"""The observer: a window on a run (rerun). It takes no part in the barrier and nothing waits for it."""
