"""Pictures of runs and scenarios for people and papers, drawn with matplotlib; nothing here runs anything."""
