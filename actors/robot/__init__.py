"""A robot's on-board software: where am I, how do I get there, and what does the user's behaviour want."""
