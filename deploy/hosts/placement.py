"""Which robot is on which host."""

from collections.abc import Mapping, Sequence


def shares(robots: Sequence[str], cores: Mapping[str, int]) -> dict[str, tuple[str, ...]]:
    """The robots of each host, in their order, by its cores; hosts without any are left out.

    Each next robot goes to the host with the fewest robots per core, among equals to the first.
    """
    counts = dict.fromkeys(cores, 0)
    for _ in robots:
        least = min(counts, key=lambda host: counts[host] / cores[host])
        counts[least] += 1
    found, first = {}, 0
    for host, count in counts.items():
        if count:
            found[host] = tuple(robots[first : first + count])
        first += count
    return found
