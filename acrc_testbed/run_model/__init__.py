"""The run model: a run from any source as typed columns, places, floor and events."""
