"""What parameters are refused, and what the presets say."""

import dataclasses
import json
from typing import Any

import pytest

from actors.bounds import ParameterError
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.localisation.recovery import Recovery


@pytest.mark.parametrize(
    ("field", "value", "right"),
    [
        ("min_particles", 0, "be at least 1"),
        ("max_particles", 499, "be at least min_particles 500"),
        ("alpha1", -0.1, "be at least 0"),
        ("sigma_hit", 0.0, "be above 0"),
        ("z_rand", 0.0, "be above 0"),
        ("recovery_fast", 1.5, "be at most 1"),
        ("z_hit", -0.5, "be at least 0"),
        ("search_poses", -1, "be at least 0"),
        ("weighting", "sum", 'be "cubes" or "product"'),
        ("odometry_model", "omni", 'be "diff" or "diff-corrected"'),
        ("max_distance", float("nan"), "be above 0"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused_with_a_sentence(field: str, value: Any, right: str) -> None:
    with pytest.raises(ParameterError) as raised:
        AmclParameters(**{field: value})
    shown = json.dumps(value) if isinstance(value, str) else f"{value:g}"
    assert str(raised.value) == f"localisation.{field} is {shown}, but must {right}"


@pytest.mark.parametrize(("slow", "fast"), [(1.0, 1.0), (0.1, 0.1), (0.5, 0.1)])
def test_the_long_average_has_to_be_the_slower_one(slow: float, fast: float) -> None:
    with pytest.raises(ParameterError) as raised:
        AmclParameters(recovery_slow=slow, recovery_fast=fast)
    sentence = f"localisation.recovery_slow is {slow:g}, but must be below recovery_fast {fast:g}"
    assert str(raised.value) == sentence


@pytest.mark.parametrize(("slow", "fast"), [(0.0, 0.0), (0.0, 0.1), (0.001, 0.0)])
def test_recovery_is_off_where_an_average_stands_still(slow: float, fast: float) -> None:
    recovery = Recovery(AmclParameters(recovery_slow=slow, recovery_fast=fast))
    assert [recovery.injection(fit) for fit in (1.0, 0.0, 0.0, 0.5)] == [0.0] * 4


@pytest.mark.parametrize("fit", [0.0, 1.0])
def test_how_likely_a_new_pose_is_stays_a_probability(fit: float) -> None:
    recovery = Recovery(AmclParameters(recovery_slow=0.999, recovery_fast=1.0))
    assert all(0.0 <= recovery.injection(fit) <= 1.0 for _ in range(2000))


def test_presets_can_be_written_down() -> None:
    for parameters in PRESETS.values():
        written = json.loads(json.dumps(dataclasses.asdict(parameters)))
        assert AmclParameters(**written) == parameters


def test_chapter_has_the_chapter_s_numbers() -> None:
    chapter = PRESETS["chapter"]
    assert (chapter.min_particles, chapter.max_particles, chapter.beams) == (500, 2000, 60)
    assert (chapter.kld_error, chapter.kld_quantile) == (0.05, 0.99)
    assert (chapter.odometry_model, chapter.weighting) == ("diff", "cubes")
    assert {chapter.alpha1, chapter.alpha2, chapter.alpha3, chapter.alpha4} == {0.2}
    assert (chapter.z_hit, chapter.z_rand, chapter.sigma_hit, chapter.max_distance) == (0.5, 0.5, 0.2, 2.0)
    assert (chapter.update_distance, chapter.update_angle, chapter.resample_interval) == (0.25, 0.2, 1)
    assert (chapter.recovery_slow, chapter.recovery_fast) == (0.0, 0.0)
    assert not chapter.beam_skip and not chapter.stranger_filter and not chapter.search_poses


def test_robust_searches_beside_the_particles_and_leaves_them_alone() -> None:
    robust = PRESETS["robust"]
    assert robust.search_poses > 0 and robust.stranger_filter and not robust.recovers
