"""Which velocity leads a robot along its plan: the original's local planner, and our own."""
