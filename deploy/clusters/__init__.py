"""Dask clusters: how they are reached, and files that start one."""
