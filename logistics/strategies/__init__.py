"""Shipped strategies of the logistics task, one per module."""
