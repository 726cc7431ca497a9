"""The scenario file: its tables, its faults in words, and what it resolves to."""
