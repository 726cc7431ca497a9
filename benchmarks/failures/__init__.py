"""How often the chapter's three failures come about."""
