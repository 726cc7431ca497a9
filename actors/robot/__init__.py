"""A robot's on-board software: localisation, navigation, and the user's behaviour."""
