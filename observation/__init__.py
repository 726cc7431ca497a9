"""What looks at what was recorded: one run, or several side by side; nothing here starts a swarm."""
