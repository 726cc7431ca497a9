"""Range sensors of a robot: drivers of lidar and depth camera, which return scans along the rays of its
model."""
