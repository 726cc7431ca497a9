"""A program that says what it has found in the memory of the server that forked it."""

from collections.abc import Sequence

from actors.floor.map_file import load_map


def main(argv: Sequence[str]) -> int:
    """Print of each map of `argv` whether its clearance was known before this process began."""
    print(*("clearance" in vars(load_map(name)) for name in argv))
    return 0
