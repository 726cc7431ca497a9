"""Global search for the pose of a lost robot, independent of the particles.

Multiple hypothesis tracking as in Jensfelt and Kristensen, "Active global localization for a mobile robot
using multiple hypothesis tracking", IEEE Transactions on Robotics and Automation 17(5), 2001: the poses that
fit a scan best are tracked by odometry, and later scans select one.
"""

import math
from functools import lru_cache
from typing import Final, NamedTuple

import msgspec
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
_MIN_PROBABILITY: Final = 1e-6
_MAX_PROBABILITY: Final = 0.999
"""Bounds of the probability of being lost."""


@lru_cache(maxsize=4096)
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

    def __init__(self, probability: float = _MIN_PROBABILITY) -> None:
        self.probability = min(max(probability, _MIN_PROBABILITY), _MAX_PROBABILITY)

    def take(self, agreeing: int, beyond: int) -> None:
        """Update with a scan at the estimate: numbers of beams that agree and that pass through a wall."""
        before = self.probability * (1 - _RETURN) + (1 - self.probability) * _HAZARD
        odds = before / (1 - before) * odds_of_lost(agreeing, beyond)
        self.probability = min(max(odds / (1 + odds), _MIN_PROBABILITY), _MAX_PROBABILITY)


_MAX_HYPOTHESES: Final = 20
"""Maximum number of hypotheses; own choices, as all below, tuned on 36 courses of `acrc verify localisation`
with a carried robot, on three maps, at 58° and 360°, alone and among four others."""
_NEW: Final = 8
"""New hypotheses per scan."""
_NEAR: Final = 0.1
"""Share of poses drawn near the estimate."""
_NEAR_SPREAD: Final = (0.5, 0.5, 0.3)
"""Their standard deviations, m, m, rad: lost robots are usually near their estimate at first."""
_TRIES: Final = 24
"""Poses tried around one to refine it."""
_FIRST_SPREAD: Final = (0.15, 0.15, 0.1)
_LATER_SPREAD: Final = (0.06, 0.06, 0.04)
_DRAWN_ACCURACY: Final = 0.25
"""Accuracy of a drawn pose, m; see `beam_scores`."""
_REFINED_ACCURACY: Final = 0.1
"""Accuracy of a refined pose, m."""
_SAME: Final = (0.5, 0.35)
"""Distances below which two hypotheses are equal, m and rad."""
_MEMORY: Final = 8
"""Number of scans in the mean of a score, approximately."""
_MIN_SCANS: Final = 6
"""Number of scans after which a hypothesis may be accepted."""
_MAX_LOST: Final = 0.1
"""Maximum probability of being wrong for an accepted hypothesis."""
_MIN_SCORE: Final = 0.5
"""Minimum score of an accepted hypothesis."""
_MIN_GAIN: Final = 0.2
"""Minimum lead of its score over that of the estimate."""
_MIN_LEAD: Final = 0.05
"""Minimum lead over all other plausible hypotheses."""


class PoseHypothesis(msgspec.Struct):
    """A possible pose of the robot."""

    frame: Pose
    """Pose of the odometry's origin in the map frame."""
    score: float
    scans: int = 0
    lost: LostProbability = msgspec.field(default_factory=lambda: LostProbability(0.5))

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
        self._coarse_scores, self._fine_scores = (
            beam_scores(plan, _DRAWN_ACCURACY),
            beam_scores(plan, _REFINED_ACCURACY),
        )
        self._points: Floats = np.empty((0, 2))
        self._hypotheses: list[PoseHypothesis] = []
        self._estimate: float | None = None

    def take(self, points: Floats, here: Pose, estimate: Pose) -> PoseHypothesis | None:
        """Process a scan; return the accepted hypothesis, if there is one.

        `points`: (b, 2), b ≥ 1, m, body's frame, end points of beams. `here`: odometry pose; `estimate`:
        current estimate, map frame.
        """
        self._points = points
        self._update_hypotheses(here, estimate)
        self._hypotheses += self._new_hypotheses(here, estimate)
        self._hypotheses.sort(key=lambda one: -one.rank)
        self._hypotheses = _distinct(self._hypotheses, here)
        accepted = self._accepted()
        if accepted is not None:  # keep the others: later scans may select one of them
            self._hypotheses.remove(accepted)
            self._estimate = accepted.score
        return accepted

    def rivals(self, here: Pose, estimate: Pose) -> int:
        """Return the number of other hypotheses that fit the scans as well as the estimate."""
        if self._estimate is None:
            return 0
        return len(
            [
                one
                for one in self._hypotheses
                if one.scans >= _MIN_SCANS
                and one.lost.probability < _MAX_LOST
                and one.score > self._estimate - _MIN_LEAD
                and not _is_same(one.frame.compose(here), estimate)
            ]
        )

    def _update_hypotheses(self, here: Pose, estimate: Pose) -> None:
        """Update and refine all hypotheses and the estimate's score with the scan."""
        score = float(self._fit(np.array([estimate]).T, self._fine_scores).score[0])
        former = self._estimate
        self._estimate = score if former is None else former + (score - former) / _MEMORY
        for one in self._hypotheses:
            predicted = one.frame.compose(here)
            fit = self._fit(np.array([predicted]).T, self._fine_scores)
            one.scans += 1
            one.score += (float(fit.score[0]) - one.score) / min(one.scans, _MEMORY)
            one.lost.take(int(fit.agreeing[0]), int(fit.beyond[0]))
            one.frame = self._refined(predicted, _LATER_SPREAD)[0].frame(here)

    def _new_hypotheses(self, here: Pose, estimate: Pose) -> list[PoseHypothesis]:
        """Return new hypotheses: the best of random poses on the map and near the estimate."""
        near = sample_around(
            estimate, _NEAR_SPREAD, normals(self._generator, (3, round(_NEAR * self._poses)))
        )
        drawn = np.hstack((self._plan.poses(self._generator, self._poses - near.shape[1]), near))
        score = self._fit(drawn, self._coarse_scores).score
        best: list[Pose] = []
        for index in np.argsort(-score, kind="stable")[: 6 * _NEW].tolist():
            pose = Pose(*drawn[:, index].tolist())
            if not any(_is_same(pose, other) for other in best):
                best.append(pose)
            if len(best) == _NEW:
                break
        accepted = []
        for pose in best:
            refined, score_there = self._refined(self._refined(pose, _FIRST_SPREAD)[0], _LATER_SPREAD)
            accepted.append(PoseHypothesis(refined.frame(here), score_there))
        return accepted

    def _refined(self, pose: Pose, spread: tuple[float, float, float]) -> tuple[Pose, float]:
        """Return the best of a pose and random ones around it, with its score."""
        draws = normals(self._generator, (3, _TRIES))
        draws[:, 0] = 0.0
        tried = sample_around(pose, spread, draws)
        score = self._fit(tried, self._fine_scores).score
        best = int(np.argmax(score))
        x, y, heading = tried[:, best].tolist()
        return Pose(x, y, wrap(heading)), float(score[best])

    def _fit(self, poses: Floats, scores: Floats) -> PoseFit:
        return explain(self._plan.grid, self._points, self._mount, poses, scores)

    def _accepted(self) -> PoseHypothesis | None:
        """Return the hypothesis to accept, if there is one."""
        candidates = [
            one for one in self._hypotheses if one.scans >= _MIN_SCANS and one.lost.probability < _MAX_LOST
        ]
        if not candidates or self._estimate is None:
            return None
        best = max(candidates, key=lambda one: one.score)
        rivals = [one.score for one in self._hypotheses if one is not best and one.lost.probability < 0.5]
        if best.score < max(_MIN_SCORE, self._estimate + _MIN_GAIN):
            return None
        return None if rivals and max(rivals) > best.score - _MIN_LEAD else best


def _is_same(one: Pose, other: Pose) -> bool:
    near = one.point.distance_to(other.point) < _SAME[0]
    return near and abs(math.remainder(one.heading - other.heading, math.tau)) < _SAME[1]


def _distinct(ranked: list[PoseHypothesis], here: Pose) -> list[PoseHypothesis]:
    """Return the first _MAX_HYPOTHESES hypotheses without duplicates."""
    distinct: list[tuple[PoseHypothesis, Pose]] = []
    for one in ranked:
        pose = one.frame.compose(here)
        if not any(_is_same(pose, other) for _, other in distinct):
            distinct.append((one, pose))
        if len(distinct) == _MAX_HYPOTHESES:
            break
    return [one for one, _ in distinct]
