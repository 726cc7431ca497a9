"""A run as robots log themselves, for RViz and Foxglove: topics and frames in one MCAP file."""
