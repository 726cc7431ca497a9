"""The recordings of several robots of one field trial, gathered into one result in one time."""
