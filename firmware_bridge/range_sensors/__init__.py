"""Range sensors of a robot: lidar and depth camera, read as scans along the rays of its model."""
