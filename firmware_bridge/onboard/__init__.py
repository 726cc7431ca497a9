"""The processes of a robot on hardware, around the robot program of the simulation."""
