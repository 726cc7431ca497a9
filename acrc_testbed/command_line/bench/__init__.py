"""Claims and benchmarks on the command line: `acrc verify` and `acrc bench`."""
