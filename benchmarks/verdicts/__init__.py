"""Whether verdicts hold what they promise: error, power, intervals, on rows of a real campaign."""
