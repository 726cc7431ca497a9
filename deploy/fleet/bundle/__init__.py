"""A robot's bundle: one archive with all that its computer needs, to be installed without a network."""
