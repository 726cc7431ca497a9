"""The run model: every run, from whatever source, as typed columns, places, floor and events."""
