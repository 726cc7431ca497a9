"""A run: preparation, preflight, supervision, result, replay and branches."""
