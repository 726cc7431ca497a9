"""Measurements that a person runs to judge the testbed."""
