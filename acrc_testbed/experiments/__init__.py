"""Several strategies compared: studies, campaigns, statistics, reports, bundles."""
