"""The Kobuki base of a TurtleBot 2: wire, motion, odometry, safety stop, driver; and an emulated one."""
