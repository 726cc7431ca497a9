"""Pages of HTML that need nothing beside themselves, light or dark as the reader's screen is."""
