"""Comparison of strategies: studies, campaigns, statistics, reports, bundles."""
