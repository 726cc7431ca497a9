"""The medium beside ns-3 and closed formulas: how right, how fast, and the figures of docs/radio.md."""
