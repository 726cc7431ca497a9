"""Where a run's time went: robots' seconds by cause, blockings, diagnoses, decisions, by ground truth."""
