"""How much of a signal arrives: path loss, walls and their materials, shadowing; and what interferes."""
