"""Map page in the browser: state of a run, and orders to it."""
