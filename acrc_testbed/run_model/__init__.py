"""The run model: a run from any source as typed columns, items, floor and events."""
