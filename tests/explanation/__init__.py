"""Tests of explanations of decisions."""
