"""Tests of campaigns, comparisons and their statistics."""
