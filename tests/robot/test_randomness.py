"""Random streams: repeatable, and none depends on another."""

import numpy as np

from actors.randomness import derived_seed, generator


def draws(seed: int = 1, purpose: str = "noise", actor: str = "r1", epoch: int = 0) -> tuple[int, ...]:
    return tuple(int(n) for n in generator(seed, purpose, actor, epoch).integers(2**62, size=4))


EXPECTED = (181797799603694115, 2812094438849263835, 3263301756773372310, 3580450795074921962)


def test_equal_arguments_give_equal_draws_in_every_version() -> None:
    assert draws() == draws() == EXPECTED


def test_every_argument_makes_another_stream() -> None:
    streams = [
        draws(),
        draws(seed=2),
        draws(purpose="noises"),
        draws(actor="r2"),
        draws(epoch=1),
        draws(purpose="r1", actor="noise"),
        draws(purpose="nois", actor="er1"),
    ]
    assert len(set(streams)) == len(streams)


def test_streams_are_independent() -> None:
    a = generator(1, "noise", "r1").standard_normal(20_000)
    b = generator(1, "noise", "r2").standard_normal(20_000)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.03  # 4 standard deviations


def test_a_robots_own_seed_is_neither_the_runs_nor_another_robots() -> None:
    seeds = [derived_seed(7, "r1"), derived_seed(7, "r2"), derived_seed(8, "r1")]
    assert len({7, 8, *seeds}) == 5
    assert all(0 <= seed < 2**63 for seed in seeds)
    assert derived_seed(7, "r1") == seeds[0]
