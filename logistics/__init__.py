"""The second task: robots carry orders between stations, and share chargers."""
