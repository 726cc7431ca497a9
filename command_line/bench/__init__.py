"""The benchmarks on the command line: `acrc bench …`."""
