"""Branches of a run that nothing was changed in, at random instants: whether each is the run itself."""
