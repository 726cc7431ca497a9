"""200 000 bytes of intact and damaged frames and noise, as `acrc bench kobuki` reads by the million."""

import json

import pytest

from benchmarks.hardware import kobuki
from firmware_bridge.kobuki import frame


def test_every_intact_frame_is_heard_through_noise_and_next_to_nothing_else() -> None:
    result = kobuki.soak(200_000, seed=5)
    assert result.bytes >= 200_000
    assert result.intact > 1500
    assert result.cut_differently == 0
    # One exclusive or cannot see all damage, and what it lets pass may hold the header of the next frame.
    assert result.believed <= result.damaged / 50
    assert result.missed <= result.believed
    assert result.missed <= result.intact / 1000
    assert result.longest_pending <= frame.LONGEST + 3
    reception = result.reception
    assert min(reception.noise, reception.bad_length, reception.bad_checksum, reception.malformed) > 0


def test_the_figures_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    result = kobuki.run(2000, json_output=True)
    assert json.loads(capsys.readouterr().out)["intact"] == result.intact
