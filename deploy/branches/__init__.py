"""Branches: a recorded run continued from an instant with one thing changed, and what differs."""
