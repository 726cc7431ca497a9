"""Runs with robots on other computers, which are workers of a Dask cluster and connect by mutual TLS."""
