"""Benchmarks of whole swarms: speed, CPU, memory, counted cost of a step, start, another commit."""
