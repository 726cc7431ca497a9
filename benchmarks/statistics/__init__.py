"""What benchmarks share: independent runs, confidence intervals, rows of a table, CPU time."""
