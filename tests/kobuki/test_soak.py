"""200 000 bytes of intact and damaged frames and noise, as `acrc verify boards` reads by the million."""

from dataclasses import replace

from benchmarks.hardware import boards, kobuki
from firmware_bridge.kobuki.wire import LONGEST


def test_every_intact_frame_is_heard_through_noise_and_next_to_nothing_else() -> None:
    result = kobuki.soak(200_000, seed=5)
    assert result.bytes >= 200_000
    assert result.intact > 1500
    assert result.borne
    for worse in (
        {"cut_differently": 1},
        {"believed": result.damaged},
        {"missed": result.believed + 1},
        {"longest_pending": LONGEST + 4},
    ):
        assert not replace(result, **worse).borne  # type: ignore[arg-type]
    reception = result.reception
    assert min(reception.noise, reception.bad_length, reception.bad_checksum, reception.malformed) > 0


def test_both_drivers_are_soaked_and_the_link_is_measured() -> None:
    found = boards.check(100_000, seed=2)
    assert found.holds, found.figures
    assert found.figures["kobuki"]["seed"] == 2 and found.figures["beeclick"]["bytes"] >= 100_000
    assert [one["data_bytes"] for one in found.figures["throughput"]] == [1, 20, 60, 118]
