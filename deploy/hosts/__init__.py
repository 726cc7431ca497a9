"""Runs with robots on other computers: found by Dask, connected by mutual TLS."""
