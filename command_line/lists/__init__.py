"""What there is to choose from, as `acrc list` shows it."""
