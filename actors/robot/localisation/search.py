"""Global search for a lost robot, beside the particles.

Hypotheses as by Jensfelt and Kristensen, "Active global localization for a mobile robot using multiple
hypothesis tracking", IEEE Transactions on Robotics and Automation 17(5), 2001: the places that explain a scan
best are followed with the odometry, and the later scans decide between them.
"""

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from actors.array_types import Floats
from actors.geometry import Pose, wrap
from actors.portable.draws import normals
from actors.robot.localisation.confidence import PoseFit, explain, worth
from actors.robot.localisation.likelihood_field import LikelihoodField
from actors.robot.localisation.motion import around


class _Shares(NamedTuple):
    """A beta distribution of the share of the beams that pass a wall, of those that agree or pass one."""

    passing: float
    agreeing: float


_TRACKING: Final = _Shares(0.05, 8.0)
"""From the right pose: a beam that grazes a corner, now and then. Own fit, as is the next: courses of
`acrc verify localisation` with 0 to 10 others, at 58° and 360°, on three maps."""
_LOST: Final = _Shares(0.5, 1.2)
"""From a wrong pose: anything, but in the mean a third."""
_HAZARD: Final = 1e-4
"""Per scan: that a robot which was not lost is now; own choice, as all below."""
_RETURN: Final = 2e-3
"""Per scan: that one which was lost is not any more."""
_LEAST_PROBABILITY: Final = 1e-6
_MOST_PROBABILITY: Final = 0.999
"""No number of scans makes either certain."""


def odds_of_lost(agreeing: int, beyond: int) -> float:
    """By what a scan with so many beams changes the odds: the likelihoods' ratio, beta-binomial each.

    The root of it, as a scan says much the same as the one before.
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
    """The probability, scan by scan, by a hidden Markov model (Rabiner, Proc. IEEE 77(2), 1989)."""

    def __init__(self, probability: float = _LEAST_PROBABILITY) -> None:
        self.probability = min(max(probability, _LEAST_PROBABILITY), _MOST_PROBABILITY)

    def take(self, agreeing: int, beyond: int) -> None:
        """One more scan, seen from where the robot would be: beams that agree, and that pass a wall."""
        before = self.probability * (1 - _RETURN) + (1 - self.probability) * _HAZARD
        odds = before / (1 - before) * odds_of_lost(agreeing, beyond)
        self.probability = min(max(odds / (1 + odds), _LEAST_PROBABILITY), _MOST_PROBABILITY)


_MOST: Final = 20
"""Hypotheses at once; own choices, as all below: tried on 36 courses of `acrc verify localisation` in which
the robot is carried away, on three maps, at 58° and 360°, alone and among four others."""
_FRESH: Final = 8
"""New ones per scan."""
_NEAR: Final = 0.1
"""Share of the tried poses that are drawn near the estimate,"""
_NEAR_SPREAD: Final = (0.5, 0.5, 0.3)
"""with these standard deviations, m, m, rad: most robots that lose their way are not far off at first."""
_TRIES: Final = 24
"""Poses tried around one to make it better."""
_FIRST_SPREAD: Final = (0.15, 0.15, 0.1)
_LATER_SPREAD: Final = (0.06, 0.06, 0.04)
_WIDE: Final = 0.25
"""How exact a pose that was only drawn is, m; see `worth`."""
_NARROW: Final = 0.1
"""The same of one that was made better."""
_APART: Final = (0.5, 0.35)
"""Nearer than both, m and rad, two hypotheses are one."""
_MEMORY: Final = 8
"""Scans that a score is the mean of, about."""
_RIPE: Final = 6
"""After so many scans a hypothesis may be believed,"""
_SURE: Final = 0.1
"""if it is wrong with no higher a probability,"""
_LEAST: Final = 0.5
"""has at least this score,"""
_BETTER: Final = 0.2
"""is so much better than the estimate,"""
_LEAD: Final = 0.05
"""and than every other hypothesis that may be right."""


@dataclass
class PoseHypothesis:
    """A place where the robot may be."""

    frame: Pose
    """Where in the map frame the odometry's origin would be."""
    score: float
    scans: int = 0
    lost: LostProbability = field(default_factory=lambda: LostProbability(0.5))

    @property
    def rank(self) -> float:
        """By what it stays or goes: its score, with a bonus for scans that were foretold."""
        return self.score + 0.02 * min(self.scans, 4) - (0.3 if self.lost.probability > 0.9 else 0.0)


class Search:
    """One search, from the scan on by which the robot was found to be lost."""

    def __init__(
        self,
        plan: LikelihoodField,
        mount: Floats,
        generator: Generator,
        poses: int,
    ) -> None:
        """`mount`: (2,), m, where beams begin in the body's frame; `poses`: so many are tried per scan."""
        self._plan = plan
        self._mount = mount
        self._generator = generator
        self._poses = poses
        self._wide, self._narrow = worth(plan, _WIDE), worth(plan, _NARROW)
        self._points: Floats = np.empty((0, 2))
        self._hypotheses: list[PoseHypothesis] = []
        self._estimate: float | None = None

    def take(self, points: Floats, here: Pose, estimate: Pose) -> PoseHypothesis | None:
        """Take one more scan; return where the robot is once that is clear.

        `points`: (b, 2), b ≥ 1, m, body's frame, the ends of its beams. `here`: the odometry's pose;
        `estimate`: the doubtful one in the map frame.
        """
        self._points = points
        self._follow(here, estimate)
        self._hypotheses += self._drawn(here, estimate)
        self._hypotheses.sort(key=lambda one: -one.rank)
        self._hypotheses = _distinct(self._hypotheses, here)
        found = self._found()
        if found is not None:  # the others stay: the scans to come may say that it was one of them
            self._hypotheses.remove(found)
            self._estimate = found.score
        return found

    def rivals(self, here: Pose, estimate: Pose) -> int:
        """How many other places explain the scans as well as the estimate: each is as likely as that."""
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
        """Every hypothesis and the estimate: how well it foretold the scan; then, what makes it better."""
        score = float(self._explained(np.array([estimate]).T, self._narrow).score[0])
        known = self._estimate
        self._estimate = score if known is None else known + (score - known) / _MEMORY
        for one in self._hypotheses:
            foretold = one.frame.compose(here)
            seen = self._explained(np.array([foretold]).T, self._narrow)
            one.scans += 1
            one.score += (float(seen.score[0]) - one.score) / min(one.scans, _MEMORY)
            one.lost.take(int(seen.agreeing[0]), int(seen.beyond[0]))
            one.frame = self._better(foretold, _LATER_SPREAD)[0].frame(here)

    def _drawn(self, here: Pose, estimate: Pose) -> list[PoseHypothesis]:
        """New hypotheses: the best of poses from all over the map, and from near the estimate."""
        near = around(estimate, _NEAR_SPREAD, normals(self._generator, (3, round(_NEAR * self._poses))))
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
        """The best of some poses around one, and of itself, with its score."""
        draws = normals(self._generator, (3, _TRIES))
        draws[:, 0] = 0.0
        tried = around(pose, spread, draws)
        score = self._explained(tried, self._narrow).score
        best = int(np.argmax(score))
        x, y, heading = tried[:, best].tolist()
        return Pose(x, y, wrap(heading)), float(score[best])

    def _explained(self, poses: Floats, worth: Floats) -> PoseFit:
        return explain(self._plan.grid, self._points, self._mount, poses, worth)

    def _found(self) -> PoseHypothesis | None:
        """The hypothesis to believe, if there is one."""
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
    """The first ones, without those that are the same as one before."""
    kept: list[tuple[PoseHypothesis, Pose]] = []
    for one in ranked:
        pose = one.frame.compose(here)
        if not any(_same(pose, other) for _, other in kept):
            kept.append((one, pose))
        if len(kept) == _MOST:
            break
    return [one for one, _ in kept]
