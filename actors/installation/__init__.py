"""Installation of this project: its folder, its version, and its command line."""
