"""A recorded run continued from an instant with one thing changed, and what became otherwise for it."""
