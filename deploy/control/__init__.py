"""A map page in the browser: where a run's robots are, and orders to the run by hand."""
