"""BEE-click radio board: serial protocol, link, and emulator."""
