"""Benchmarks (`acrc bench`) and comparisons with other software (`acrc verify`)."""
