"""What claims and benchmarks share: figures with a verdict, independent runs, intervals, CPU time."""
