"""The floor: a grid of free, unknown and occupied cells, where it comes from, and what is computed on it."""
