"""The world alone: physics, scans and floor plans, beside other simulators."""
