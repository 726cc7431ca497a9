"""Kobuki base of a TurtleBot 2: protocol, motion, odometry, safety stop, driver, and emulator."""
