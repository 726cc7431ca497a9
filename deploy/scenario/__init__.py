"""Scenario files: tables, checks, resolution and survey."""
