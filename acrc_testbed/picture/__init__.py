"""Pictures, movies and HTML pages of runs and scenarios, drawn with matplotlib."""
