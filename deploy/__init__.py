"""Deployment: scenarios, runs and their branches, hosts of a cluster, and fleets of physical robots."""
