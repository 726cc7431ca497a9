"""HTML pages of runs and reports that need no other files, light or dark as the reader's screen is."""
