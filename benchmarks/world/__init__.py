"""The world alone: physics and scans, beside other simulators."""
