"""Causes of lost time, and causes of robots' decisions."""
