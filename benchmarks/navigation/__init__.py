"""How well robots get to their goals, and what a log of their decisions shows."""
