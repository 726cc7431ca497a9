"""What is wrong with a robot's computer, and how to put it right."""
