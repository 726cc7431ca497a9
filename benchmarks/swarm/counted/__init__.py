"""What one robot's step costs, counted and never timed, and the table of it that a change is held to."""
