"""Introspection that cannot be is refused in one sentence, whatever recording it comes from."""

from pathlib import Path

import numpy as np
import pytest

from acrc_testbed.recordings.run_recordings import run_of
from acrc_testbed.run_model.introspection import (
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
    ReplicaContact,
)
from actors.messages import Odometry, Scan, Senses

CERTAIN = EstimateQuality((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), 0.0, True)
POSE = (0.0, 0.0, 0.0)


@pytest.fixture
def model(short_run: Path) -> ProcessModel:
    path = short_run / "r1" / "r1.mcap"
    return process_model(RecordedProcess("r1", "r1", seconds_of), path, run_of(path))


def senses(step: int, scan: Scan | None = None) -> Senses:
    return Senses(step, step * 100_000, 0, Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0, scan)


def sample(**parts: object) -> Introspection:
    whole = {"sensor": None, "particles": None, "plan": None, "window": None, **parts}
    return Introspection(0, 0, CERTAIN, POSE, sample=PerceptionSample(**whole))  # type: ignore[arg-type]


HOSTILE = {
    "its covariance has 2 values": Introspection(0, 0, EstimateQuality((1.0, 2.0), 0.0, True), POSE),
    "5 bytes are no points": sample(plan=b"12345"),
    "7 bytes": sample(particles=b"1234567"),
    "has 3 rows": sample(window=CostWindow(POSE, 3, b"")),
    "and all its marks": sample(window=CostWindow(POSE, 80, np.array([6400], "<u2").tobytes())),
    "no clock shows": Introspection(0, 0, contacts=(ReplicaContact("r2", 2**62),)),
    "a scan has 2 rays": sample(sensor=POSE),
    "as no clock": Introspection(0, 0, commits=(KnowledgeCommit(2**62, "r1", "a", True, "", 0, ()),)),
}


@pytest.mark.parametrize(("fault", "told"), HOSTILE.items(), ids=HOSTILE)
def test_what_cannot_be_is_refused(model: ProcessModel, fault: str, told: Introspection) -> None:
    model.extend(senses(0, Scan(0, b"1234")))
    model.extend(told)
    with pytest.raises(IntrospectionError, match=f"r1: its introspection of step 0 is damaged: .*{fault}"):
        model.take(0, {})


def test_parts_make_up_the_whole(model: ProcessModel) -> None:
    for step in range(4):
        model.extend(senses(step))
        model.extend(Introspection(step, 0, CERTAIN, POSE, knowledge=((f"field {step}", "new"),)))
    first, second = model.take(1, {}), model.take(3, {})
    assert [one.step for one in (*first.step_estimates, *second.step_estimates)] == [0, 1, 2, 3]
    assert (first.end, second.end) == (0.1, 0.3) and first.is_recorded
    assert second.knowledge[-1] == (0.3, tuple((f"field {step}", "new") for step in range(4)))
