"""What researchers of self-adaptation do daily: runs of several strategies, compared so that it holds."""
