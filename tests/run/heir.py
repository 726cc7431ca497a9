"""Program that prints which data its forkserver had loaded before the fork."""

from collections.abc import Sequence

from actors.floor.map_file import load_map


def main(argv: Sequence[str]) -> int:
    """Print for each map in `argv` whether its clearance was computed before the fork."""
    print(*("clearance" in vars(load_map(name)) for name in argv))
    return 0
