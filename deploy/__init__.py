"""What starts and ends programs on computers: a scenario, its run, branches of it, fleets, the laboratory."""
