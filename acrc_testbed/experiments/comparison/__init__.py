"""What the trials of a campaign say about each pair of strategies, and how sure that is."""
