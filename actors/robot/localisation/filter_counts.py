"""What a filter did, counted."""

from dataclasses import dataclass


@dataclass
class FilterCounts:
    """Of one run, so far."""

    updates: int = 0
    """Scans that counted."""
    blind: int = 0
    """Those of them without any beam to believe."""
    resamplings: int = 0
    particles: int = 0
    """Sum over the scans that counted."""
    injected: int = 0
    """New poses tried."""
    lost: int = 0
    """Scans that counted after which the robot was more likely lost than not."""
    found: int = 0
    """How often the search found it somewhere else."""
    beams_used: int = 0
    beams_masked: int = 0
    """Dropped as they ended at a masked peer."""
    beams_strange: int = 0
    """Dropped as they ended at what is not on the map."""
    beams_skipped: int = 0
    """Dropped as few particles agreed with them."""

    def outcome(self) -> dict[str, object]:
        """By name; of the particles the mean."""
        counted: dict[str, object] = dict(vars(self))
        del counted["particles"]
        counted["mean_particles"] = round(self.particles / self.updates, 1) if self.updates else 0.0
        return counted
