"""The BEE-click radio board: what it says on its serial line, the link to it, and an emulated one."""
