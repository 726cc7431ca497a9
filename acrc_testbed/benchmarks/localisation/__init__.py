"""How well the robot's localisation keeps track, beside the truth of the world's own sensing and odometry."""
