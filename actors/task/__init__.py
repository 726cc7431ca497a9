"""Interface and loading of tasks."""
