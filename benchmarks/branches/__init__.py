"""Branches without a change, at random instants: whether each has the run's digest."""
