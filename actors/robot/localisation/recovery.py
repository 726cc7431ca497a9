"""When a filter looks for its robot elsewhere: the fit of the last scans against that of the long run."""

from actors.robot.localisation.parameters import AmclParameters


class Recovery:
    """The averages w_slow and w_fast of "Probabilistic Robotics", 2005, table 8.3.

    They are kept of the fit per beam, as the fit of a whole scan changes with the number of its beams. As in
    the book, and unlike ros-planning/navigation, pf.c, they live on after new poses were tried: where both
    begin anew at a bad fit, the robot is never looked for again.
    """

    def __init__(self, parameters: AmclParameters) -> None:
        self._parameters = parameters
        self._slow = 0.0
        self._fast = 0.0

    def injection(self, fit: float) -> float:
        """How likely a particle is to be a new pose, after a scan of that fit."""
        if self._slow == 0.0:
            self._slow = self._fast = fit
        self._slow += self._parameters.recovery_slow * (fit - self._slow)
        self._fast += self._parameters.recovery_fast * (fit - self._fast)
        return max(0.0, 1.0 - self._fast / self._slow) if self._slow > 0.0 else 0.0
