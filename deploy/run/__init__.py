"""A whole run: laid out, preflighted, started, watched, and ended."""
