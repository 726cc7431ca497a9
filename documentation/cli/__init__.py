"""`acrc docs`; what it needs is imported once it is called."""
