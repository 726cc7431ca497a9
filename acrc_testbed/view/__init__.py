"""View of a run in the viewer, drawn from its recordings."""
