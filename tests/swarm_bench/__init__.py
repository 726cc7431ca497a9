"""Tests of the benchmark of full swarms."""
