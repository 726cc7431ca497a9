"""ROS 2 robots and tools over Zenoh, without ROS: names, message types, session, base."""
