"""Where the original testbed had its places: the forty points that it drew on the corridor map.

Source: d3scomp/deeco-adaptation-testbed, PositionGenerator and GarbageCollectDemo. The six areas that it drew
them in stand in the shipped scenario.
"""

from typing import Final

from actors.geometry import Point

GOLDEN: Final[tuple[tuple[Point, ...], ...]] = (
    (
        Point(21.216, 11.918),
        Point(17.665, 6.420),
        Point(8.456, 12.329),
        Point(23.105, 12.257),
        Point(18.843, 11.570),
        Point(7.928, 13.289),
        Point(17.528, 5.508),
        Point(10.890, 13.094),
        Point(12.216, 5.907),
        Point(14.042, 12.991),
    ),
    (
        Point(8.583, 13.617),
        Point(20.843, 12.078),
        Point(3.337, 12.312),
        Point(10.002, 13.292),
        Point(17.959, 3.762),
        Point(2.740, 11.575),
        Point(19.643, 12.216),
        Point(21.349, 11.936),
        Point(9.218, 13.410),
        Point(20.680, 12.092),
    ),
    (
        Point(23.019, 11.620),
        Point(20.773, 12.328),
        Point(3.600, 12.783),
        Point(12.495, 1.164),
        Point(12.468, 4.930),
        Point(13.771, 12.119),
        Point(21.914, 13.469),
        Point(14.058, 11.304),
        Point(17.981, 13.483),
        Point(9.700, 11.981),
    ),
    (
        Point(3.357, 11.356),
        Point(17.117, 13.234),
        Point(11.686, 1.162),
        Point(8.508, 13.664),
        Point(26.454, 11.137),
        Point(19.922, 13.313),
        Point(11.756, 12.574),
        Point(12.677, 6.371),
        Point(18.811, 13.495),
        Point(17.832, 13.650),
    ),
)
"""The ten places of each of the testbed's four robots, m, to the millimetre: what its generator gives for its
seed, java.util.Random(42). Some lie nearer to a wall than a robot's radius: they are reached from within
0.5 m."""
