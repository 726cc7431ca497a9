"""Descriptions and diagrams of components and ensembles, from their source."""
