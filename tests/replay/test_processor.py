"""A recording from another processor: its notes name it, and a replay that differs says so."""

import json
from pathlib import Path

import msgspec
import pytest

from actors.robot import assembly
from actors.runtime.bus.replay_bus import ReplayError
from actors.runtime.process import RunNote
from actors.runtime.processor import Processor, processor
from actors.runtime.recording import Entry, Note, read_notes
from observation.replay.record_replay import replay_actor
from tests.replay.forging import forge, with_payload

ELSEWHERE = Processor("aarch64", "Cortex-A76", ("neon",))
SINE = "actors.portable.arrays.sin"


def from_elsewhere(item: Entry | Note) -> Entry | Note:
    """The run's note as of another processor, whose sine has other bits."""
    if not isinstance(item, Note) or item.name != "run":
        return item
    run = msgspec.json.decode(item.json, type=RunNote)
    assert SINE in run.kernels
    other = msgspec.structs.replace(run, processor=ELSEWHERE, kernels=run.kernels | {SINE: "0" * 64})
    return item._replace(json=msgspec.json.encode(other).decode())


def from_elsewhere_and_different(item: Entry | Note) -> Entry | Note:
    """The same, with another last bit in what the robot sent in step 5."""
    if isinstance(item, Entry) and item.direction == "out" and item.step == 5 and item.payload is not None:
        return with_payload(item, item.payload[:-1] + bytes([item.payload[-1] ^ 1]))
    return from_elsewhere(item)


def test_result_and_first_record_name_the_processor(recorded: Path) -> None:
    here = processor()
    result = json.loads((recorded / "run.json").read_text())
    assert msgspec.convert(result["processor"], Processor) == here
    for path in sorted(recorded.glob("*/*.mcap")):
        run = msgspec.json.decode(read_notes(path)["run"], type=RunNote)
        assert run.processor == here
        assert SINE in run.kernels and "actors.portable.foundations.numpy.sqrt" in run.kernels


def test_a_replay_that_differs_names_processor_function_and_features(copy: Path) -> None:
    assert SINE in assembly.kernels()
    forge(copy / "r1" / "r1.mcap", from_elsewhere_and_different)
    with pytest.raises(ReplayError) as caught:
        replay_actor(copy, "r1")
    assert str(caught.value).endswith(
        f"; recorded on another processor: other bits come from {SINE}; "
        f"it was {ELSEWHERE}, this is {processor()}"
    )
    assert "step 5" in str(caught.value)


def test_a_replay_that_agrees_all_the_same_is_content(copy: Path) -> None:
    forge(copy / "r1" / "r1.mcap", from_elsewhere)
    assert replay_actor(copy, "r1").outputs > 30
