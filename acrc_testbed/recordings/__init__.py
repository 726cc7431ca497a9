"""Readers of recordings, also of a run in progress."""
