"""Global search for the pose of a lost robot, independent of the particles.

Multiple hypothesis tracking as in Jensfelt and Kristensen, "Active global localization for a mobile robot
using multiple hypothesis tracking", IEEE Transactions on Robotics and Automation 17(5), 2001: the poses that
fit a scan best are tracked by odometry, and later scans select one.
"""

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from actors.array_types import Floats
from actors.geometry import Pose, wrap
from actors.portable.draws import normals
from actors.robot.localisation.confidence import PoseFit, beam_scores, explain
from actors.robot.localisation.likelihood_field import LikelihoodField
from actors.robot.localisation.motion import sample_around


class _Shares(NamedTuple):
    """Beta distribution of the share of beams that pass through a wall, among those that agree or pass."""

    passing: float
    agreeing: float


_TRACKING: Final = _Shares(0.05, 8.0)
"""At the correct pose: few beams, which graze a corner. Fitted, like the next, to courses of
`acrc verify localisation` with 0 to 10 other robots, at 58° and 360°, on three maps."""
_LOST: Final = _Shares(0.5, 1.2)
"""At a wrong pose: any share, a third on average."""
_HAZARD: Final = 1e-4
"""Probability per scan of becoming lost; own choice, as all below."""
_RETURN: Final = 2e-3
"""Probability per scan of a lost robot no longer being lost."""
_LEAST_PROBABILITY: Final = 1e-6
_MOST_PROBABILITY: Final = 0.999
"""Bounds of the probability of being lost."""


def odds_of_lost(agreeing: int, beyond: int) -> float:
    """Return the factor by which a scan changes the odds of being lost: a ratio of beta-binomial likelihoods.

    The square root of the ratio, since consecutive scans are correlated.
    """
    ratio = 1.0
    for i in range(beyond):
        ratio *= (_LOST.passing + i) / (_TRACKING.passing + i)
    for i in range(agreeing):
        ratio *= (_LOST.agreeing + i) / (_TRACKING.agreeing + i)
    for i in range(beyond + agreeing):
        ratio *= (_TRACKING.passing + _TRACKING.agreeing + i) / (_LOST.passing + _LOST.agreeing + i)
    return math.sqrt(ratio)


class LostProbability:
    """Probability of being lost, by a hidden Markov model (Rabiner, Proc. IEEE 77(2), 1989)."""

    def __init__(self, probability: float = _LEAST_PROBABILITY) -> None:
        self.probability = min(max(probability, _LEAST_PROBABILITY), _MOST_PROBABILITY)

    def take(self, agreeing: int, beyond: int) -> None:
        """Update with a scan at the estimate: numbers of beams that agree and that pass through a wall."""
        before = self.probability * (1 - _RETURN) + (1 - self.probability) * _HAZARD
        odds = before / (1 - before) * odds_of_lost(agreeing, beyond)
        self.probability = min(max(odds / (1 + odds), _LEAST_PROBABILITY), _MOST_PROBABILITY)


_MOST: Final = 20
"""Maximum number of hypotheses; own choices, as all below, tuned on 36 courses of `acrc verify localisation`
with a carried robot, on three maps, at 58° and 360°, alone and among four others."""
_FRESH: Final = 8
"""New hypotheses per scan."""
_NEAR: Final = 0.1
"""Share of poses drawn near the estimate."""
_NEAR_SPREAD: Final = (0.5, 0.5, 0.3)
"""Their standard deviations, m, m, rad: lost robots are usually near their estimate at first."""
_TRIES: Final = 24
"""Poses tried around one to refine it."""
_FIRST_SPREAD: Final = (0.15, 0.15, 0.1)
_LATER_SPREAD: Final = (0.06, 0.06, 0.04)
_WIDE: Final = 0.25
"""Accuracy of a drawn pose, m; see `beam_scores`."""
_NARROW: Final = 0.1
"""Accuracy of a refined pose, m."""
_APART: Final = (0.5, 0.35)
"""Distances below which two hypotheses are equal, m and rad."""
_MEMORY: Final = 8
"""Number of scans in the mean of a score, approximately."""
_RIPE: Final = 6
"""Number of scans after which a hypothesis may be accepted."""
_SURE: Final = 0.1
"""Maximum probability of being wrong for an accepted hypothesis."""
_LEAST: Final = 0.5
"""Minimum score of an accepted hypothesis."""
_BETTER: Final = 0.2
"""Minimum lead of its score over that of the estimate."""
_LEAD: Final = 0.05
"""Minimum lead over all other plausible hypotheses."""


@dataclass
class PoseHypothesis:
    """A possible pose of the robot."""

    frame: Pose
    """Pose of the odometry's origin in the map frame."""
    score: float
    scans: int = 0
    lost: LostProbability = field(default_factory=lambda: LostProbability(0.5))

    @property
    def rank(self) -> float:
        """Score with a bonus for the number of scans and a penalty if probably wrong."""
        return self.score + 0.02 * min(self.scans, 4) - (0.3 if self.lost.probability > 0.9 else 0.0)


class PoseSearch:
    """A search for the pose of a lost robot."""

    def __init__(self, plan: LikelihoodField, mount: Floats, generator: Generator, poses: int) -> None:
        """Create a search. `mount`: (2,), m, origin of beams, body's frame; `poses`: poses tried per scan."""
        self._plan = plan
        self._mount = mount
        self._generator = generator
        self._poses = poses
        self._wide, self._narrow = beam_scores(plan, _WIDE), beam_scores(plan, _NARROW)
        self._points: Floats = np.empty((0, 2))
        self._hypotheses: list[PoseHypothesis] = []
        self._estimate: float | None = None

    def take(self, points: Floats, here: Pose, estimate: Pose) -> PoseHypothesis | None:
        """Process a scan; return the accepted hypothesis, if there is one.

        `points`: (b, 2), b ≥ 1, m, body's frame, end points of beams. `here`: odometry pose; `estimate`:
        current estimate, map frame.
        """
        self._points = points
        self._follow(here, estimate)
        self._hypotheses += self._drawn(here, estimate)
        self._hypotheses.sort(key=lambda one: -one.rank)
        self._hypotheses = _distinct(self._hypotheses, here)
        found = self._found()
        if found is not None:  # keep the others: later scans may select one of them
            self._hypotheses.remove(found)
            self._estimate = found.score
        return found

    def rivals(self, here: Pose, estimate: Pose) -> int:
        """Return the number of other hypotheses that fit the scans as well as the estimate."""
        if self._estimate is None:
            return 0
        as_good = [
            one
            for one in self._hypotheses
            if one.scans >= _RIPE
            and one.lost.probability < _SURE
            and one.score > self._estimate - _LEAD
            and not _same(one.frame.compose(here), estimate)
        ]
        return len(as_good)

    def _follow(self, here: Pose, estimate: Pose) -> None:
        """Update and refine all hypotheses and the estimate's score with the scan."""
        score = float(self._explained(np.array([estimate]).T, self._narrow).score[0])
        known = self._estimate
        self._estimate = score if known is None else known + (score - known) / _MEMORY
        for one in self._hypotheses:
            predicted = one.frame.compose(here)
            fit = self._explained(np.array([predicted]).T, self._narrow)
            one.scans += 1
            one.score += (float(fit.score[0]) - one.score) / min(one.scans, _MEMORY)
            one.lost.take(int(fit.agreeing[0]), int(fit.beyond[0]))
            one.frame = self._better(predicted, _LATER_SPREAD)[0].frame(here)

    def _drawn(self, here: Pose, estimate: Pose) -> list[PoseHypothesis]:
        """Return new hypotheses: the best of random poses on the map and near the estimate."""
        near = sample_around(
            estimate, _NEAR_SPREAD, normals(self._generator, (3, round(_NEAR * self._poses)))
        )
        drawn = np.hstack((self._plan.poses(self._generator, self._poses - near.shape[1]), near))
        score = self._explained(drawn, self._wide).score
        best: list[Pose] = []
        for index in np.argsort(-score, kind="stable")[: 6 * _FRESH].tolist():
            pose = Pose(*drawn[:, index].tolist())
            if not any(_same(pose, other) for other in best):
                best.append(pose)
            if len(best) == _FRESH:
                break
        found = []
        for pose in best:
            better, score_there = self._better(self._better(pose, _FIRST_SPREAD)[0], _LATER_SPREAD)
            found.append(PoseHypothesis(better.frame(here), score_there))
        return found

    def _better(self, pose: Pose, spread: tuple[float, float, float]) -> tuple[Pose, float]:
        """Return the best of a pose and random ones around it, with its score."""
        draws = normals(self._generator, (3, _TRIES))
        draws[:, 0] = 0.0
        tried = sample_around(pose, spread, draws)
        score = self._explained(tried, self._narrow).score
        best = int(np.argmax(score))
        x, y, heading = tried[:, best].tolist()
        return Pose(x, y, wrap(heading)), float(score[best])

    def _explained(self, poses: Floats, scores: Floats) -> PoseFit:
        return explain(self._plan.grid, self._points, self._mount, poses, scores)

    def _found(self) -> PoseHypothesis | None:
        """Return the hypothesis to accept, if there is one."""
        ripe = [one for one in self._hypotheses if one.scans >= _RIPE and one.lost.probability < _SURE]
        if not ripe or self._estimate is None:
            return None
        best = max(ripe, key=lambda one: one.score)
        rivals = [one.score for one in self._hypotheses if one is not best and one.lost.probability < 0.5]
        if best.score < max(_LEAST, self._estimate + _BETTER):
            return None
        return None if rivals and max(rivals) > best.score - _LEAD else best


def _same(one: Pose, other: Pose) -> bool:
    near = one.point.distance_to(other.point) < _APART[0]
    return near and abs(math.remainder(one.heading - other.heading, math.tau)) < _APART[1]


def _distinct(ranked: list[PoseHypothesis], here: Pose) -> list[PoseHypothesis]:
    """Return the first _MOST hypotheses without duplicates."""
    kept: list[tuple[PoseHypothesis, Pose]] = []
    for one in ranked:
        pose = one.frame.compose(here)
        if not any(_same(pose, other) for _, other in kept):
            kept.append((one, pose))
        if len(kept) == _MOST:
            break
    return [one for one, _ in kept]
