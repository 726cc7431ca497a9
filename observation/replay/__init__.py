"""The recordings of a run: compared with one another, and executed again."""
