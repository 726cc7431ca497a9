"""A whole run: laid out, tried once, started, watched, ended."""
