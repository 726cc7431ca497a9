"""What a branch changes, as it is typed, and how it comes among the recorded orders."""

from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.messages import CONTROL, Control
from actors.orders import Freeze, Kill, Pause, Resume, Thaw
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from deploy.branches import change
from observation.replay.recorded_orders import TimedControl


def _control(step: int, *orders: object) -> TimedControl:
    return TimedControl(step, encode(Control(0, orders), CONTROL.key()))  # type: ignore[arg-type]


def _orders(given: TimedControl) -> tuple[object, ...]:
    told = decode(at(CONTROL).topic, CONTROL.key(), given.payload)
    assert isinstance(told, Control)
    return told.orders


def test_events_come_before_what_the_run_was_given_at_their_boundary() -> None:
    recorded = [_control(20, Pause()), _control(20, Resume()), _control(50, Thaw("r1"))]
    events = [change.event("kill r2 at 2", 1.0), change.event("freeze r1 at 3.95", 1.0)]
    given = change.with_events(recorded, events, 100_000)
    assert [(one.step, _orders(one)) for one in given] == [
        (20, (Kill("r2"), Pause())),
        (20, (Resume(),)),
        (40, (Freeze("r1"),)),
        (50, (Thaw("r1"),)),
    ]


def test_an_event_without_instant_happens_where_the_branch_leaves() -> None:
    assert change.event("kill r2", 7.5).at_s == 7.5


@pytest.mark.parametrize("text", ["", "at 5", "kill r2 at 1", "kill r2 at x", "dance r2", "pause", "speed 2"])
def test_events_that_are_none(text: str) -> None:
    with pytest.raises(OptionError, match="--event"):
        change.event(text, 2.0)


def test_a_place_in_a_run() -> None:
    assert change.place("runs/a@b@59.5") == (Path("runs/a@b"), 59.5)


@pytest.mark.parametrize("text", ["runs/seen", "@5", "runs/seen@", "runs/seen@0", "runs/seen@nan"])
def test_no_place_in_a_run(text: str) -> None:
    with pytest.raises(OptionError, match="branch: "):
        change.place(text)
