"""The processes of a robot on hardware: what is around the robot program of the simulation."""
