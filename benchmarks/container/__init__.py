"""The recipes of the container, carried out in a bare Debian tree, and a run in what comes of it."""
