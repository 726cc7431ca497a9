"""The benchmark of localisation: its courses, its figures, its file."""
