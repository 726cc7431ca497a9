"""The recordings of a run: compared with one another, and replayed."""
