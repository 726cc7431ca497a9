"""When a filter looks for its robot elsewhere: the fit of the last scans against that of the long run."""

from actors.robot.localisation.parameters import AmclParameters


class Recovery:
    """The averages w_slow and w_fast of "Probabilistic Robotics", 2005, table 8.3.

    They are kept of the fit, which lies in 0 to 1, and not of the likelihood of a whole scan, which changes
    with the number of its beams. They begin at 1, so that a filter that begins at the wrong place finds out.
    As in the book, and unlike ros-planning/navigation, pf.c, they live on after new poses were tried: where
    both begin anew at a bad fit, the robot is never looked for again.
    """

    def __init__(self, parameters: AmclParameters) -> None:
        self._parameters = parameters
        self._slow = 1.0
        self._fast = 1.0

    def injection(self, fit: float) -> float:
        """How likely a particle is to be a new pose, after a scan of that fit; 0 where recovery is off."""
        parameters = self._parameters
        if not parameters.recovers:
            return 0.0
        self._slow += parameters.recovery_slow * (fit - self._slow)
        self._fast += parameters.recovery_fast * (fit - self._fast)
        if self._slow <= 0.0:  # after hundreds of scans that fit nowhere at all
            return 1.0
        return max(0.0, 1.0 - self._fast / self._slow)
