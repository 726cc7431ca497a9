"""Runs: preparation, preflight, supervision, result, replay and branches."""
