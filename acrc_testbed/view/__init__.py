"""A run opened in the viewer: read from its recordings, drawn, computed where nothing was recorded, shown."""
