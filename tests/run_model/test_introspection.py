"""Rejection of invalid introspection, and introspection read in parts."""

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from acrc_testbed.recordings.run_recordings import read_run_note
from acrc_testbed.run_model.robot_introspection import (
    IntrospectionError,
    ProcessModel,
    RecordedProcess,
    process_model,
    seconds_of,
)
from actors.introspection import (
    CostWindow,
    EstimateQuality,
    Introspection,
    KnowledgeCommit,
    PerceptionSample,
    StepRecord,
)
from actors.messages import Drive, Odometry, Scan, SensorData

CERTAIN = EstimateQuality((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), 0.0, True)
POSE = (0.0, 0.0, 0.0)


@pytest.fixture
def model(short_run: Path) -> ProcessModel:
    path = short_run / "r1" / "r1.mcap"
    return process_model(RecordedProcess("r1", "r1", seconds_of), path, read_run_note(path))


def senses(step: int, scan: Scan | None = None) -> SensorData:
    return SensorData(step, step * 100_000, 0, Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0, scan)


def step(number: int = 0, quality: EstimateQuality = CERTAIN, **parts: object) -> Introspection:
    return Introspection(number, (StepRecord(number, quality, POSE, **parts),))  # type: ignore[arg-type]


def sample(**parts: object) -> Introspection:
    whole = {"scanned": None, "particles": None, "plan": None, "window": None, **parts}
    return structs.replace(step(), sample=PerceptionSample(**whole))  # type: ignore[arg-type]


HOSTILE = {
    "covariance has 2 values": step(quality=EstimateQuality((1.0, 2.0), 0.0, True)),
    "5 bytes of points": sample(plan=b"12345"),
    "7 bytes": sample(particles=b"1234567"),
    "has 3 rows": sample(window=CostWindow((0, 0), 3, b"")),
    "or cells beyond them": sample(window=CostWindow((0, 0), 80, np.array([6400], "<u2").tobytes())),
    "µs is out of range": step(contacts=(("r2", 2**62),)),
    "a scan has 2 rays": sample(scanned=POSE),
    "instant .* is out of range": step(commits=(KnowledgeCommit(2**62, "r1", "a", True, "", 0, ()),)),
}


@pytest.mark.parametrize(("fault", "told"), HOSTILE.items(), ids=HOSTILE)
def test_invalid_introspection_is_rejected(model: ProcessModel, fault: str, told: Introspection) -> None:
    model.extend(senses(0, Scan(0, b"1234")))
    model.extend(told)
    with pytest.raises(IntrospectionError, match=f"r1: introspection of step 0 is damaged: .*{fault}"):
        model.take(0, {})


def test_parts_make_up_the_whole(model: ProcessModel) -> None:
    for number in range(4):
        model.extend(senses(number))
        model.extend(structs.replace(step(number), knowledge=((f"field {number}", "new"),)))
    first, second = model.take(1, {}), model.take(3, {})
    assert [one.step for one in (*first.step_estimates, *second.step_estimates)] == [0, 1, 2, 3]
    assert (first.end, second.end) == (0.1, 0.3) and first.is_recorded
    assert second.knowledge[-1] == (0.3, tuple((f"field {number}", "new") for number in range(4)))


def test_steps_wait_for_their_introspection(model: ProcessModel) -> None:
    for number in range(8):
        model.extend(senses(number))
    assert model.take(5, {}).step_estimates == ()
    model.extend(Introspection(5, (StepRecord(1, CERTAIN, POSE), StepRecord(5, None, POSE))))
    part = model.take(7, {2: Drive(2, 0.0, 0.0, 0.0, 0, pose=POSE)})
    assert [one.step for one in part.step_estimates] == [1, 2, 5] and part.end == 0.5
