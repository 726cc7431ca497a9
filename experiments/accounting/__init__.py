"""Where a run's time went: each robot's seconds by cause, blockings, diagnoses and decisions, by ground truth."""
