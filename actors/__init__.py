"""The actors of a swarm: one world, one radio, one process per robot, and optional observers."""

import os
import sys

# Search this environment's packages before those on PYTHONPATH, such as those of a sourced ROS.
_ADDED = [os.path.abspath(entry) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep)]  # noqa: PTH100
sys.path.sort(key=_ADDED.__contains__)
