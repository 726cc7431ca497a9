"""How the view looks and how often it changes."""

from dataclasses import dataclass

Colour = tuple[int, int, int]

PALETTE: tuple[Colour, ...] = (
    (214, 39, 40),
    (31, 85, 214),
    (26, 140, 45),
    (20, 20, 20),
    (128, 128, 128),
    (230, 126, 0),
    (140, 60, 190),
    (0, 150, 170),
    (200, 60, 140),
    (130, 90, 50),
)
"""Red, blue, green, black as in the chapter's figures, then grey, orange, violet, teal, pink, brown."""


@dataclass(frozen=True)
class Appearance:
    """What a person may want to look different; nothing here changes a run."""

    period_us: int = 100_000
    """Least simulated time between two pictures, µs. Default: ten a second, more than an eye follows."""
    robot_radius: float = 0.177
    """Radius of a drawn robot, m. Default: TurtleBot 2 as in the original's Stage model (0.354 m wide)."""
    trail_spacing: float = 0.05
    """Least distance between two points of a trajectory, m. Default: a cell or two of the map."""
    trail_jump: float = 1.0
    """A robot that is this far, m, from its last picture was put there by hand: its trajectory begins anew.
    Default: twenty times what a TurtleBot covers between two pictures."""
    palette: tuple[Colour, ...] = PALETTE
    """Colours of the robots in the scenario's order (red, green, blue 0 to 255); then they repeat."""
    paleness: float = 0.75
    """How far towards white the colour of a reported place goes, 0 to 1. Default: still to be told apart."""
    label_offset: float = 0.7
    """How far north of its robot a name stands, m; the text has its own size whatever the zoom."""
    paper: int = 205
    """Brightness, 0 to 255, around the map and in its unknown parts. Default: map_server's grey for those."""

    def colour(self, number: int) -> Colour:
        """The colour of the robot with that number in the scenario."""
        return self.palette[number % len(self.palette)]

    def pale(self, colour: Colour) -> Colour:
        """The colour of what is done with."""
        red, green, blue = (round(part + (255 - part) * self.paleness) for part in colour)
        return red, green, blue
