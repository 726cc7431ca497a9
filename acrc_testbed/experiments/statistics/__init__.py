"""Comparisons of samples: effects, intervals, tests, times that may be censored; knows nothing of robots."""
