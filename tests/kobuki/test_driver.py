"""The driver at an emulated base: who it is, what it tells, what it sends and how often."""

import pytest

from actors.instant import Instant
from firmware_bridge.kobuki.driver import (
    BaseIdentity,
    BatteryChanged,
    BatteryLevel,
    Colour,
    FieldChanged,
    Found,
    Identified,
    Lost,
    Sense,
    StopsChanged,
)
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.kobuki.wire import (
    POWER_RAILS,
    UDID,
    BaseControl,
    Command,
    FirmwareVersion,
    GeneralOutput,
    Melody,
    RequestExtra,
    SoundSequence,
    encode_frame,
)
from tests.kobuki.drives import Rig


def heard(rig: Rig, kind: type[Command]) -> list[Command]:
    return [command for _, command in rig.base.heard if isinstance(command, kind)]


def test_a_base_is_found_and_says_who_it_is() -> None:
    rig = Rig()
    rig.base.faults.silent = True
    rig.run(2.0)
    assert rig.driver.waiting(rig.now) == (
        "no feedback from the Kobuki for 2.0 s: it should be switched on, its USB cable plugged in, "
        "and its battery charged"
    )
    assert [type(event) for event in rig.told] == [StopsChanged]
    rig.base.faults.silent = False
    rig.run(1.0)
    assert rig.driver.waiting(rig.now) is None
    assert [event for event in rig.told if isinstance(event, Found)] != []
    identity = BaseIdentity(FirmwareVersion(1, 0, 4), FirmwareVersion(1, 1, 4), UDID((1, 2, 3)))
    assert rig.driver.identity == identity
    assert [event.identity for event in rig.told if isinstance(event, Identified)] == [identity]
    assert len(heard(rig, RequestExtra)) == 1


def test_a_base_that_never_answers_is_asked_five_times() -> None:
    rig = Rig()
    rig.base._answer = lambda flags: None  # type: ignore[method-assign]
    rig.run(10.0)
    assert len(heard(rig, RequestExtra)) == 5
    assert not rig.driver.identity.complete


def test_a_lost_base_is_told_and_asked_anew_when_it_is_back() -> None:
    rig = Rig()
    rig.run(1.0, (0.2, 0.0))
    assert rig.driver.odometry.read().vx > 0.1
    rig.base.faults.silent = True
    rig.run(0.5)
    lost = next(event for event in rig.told if isinstance(event, Lost))
    assert 100_000 < lost.instant - lost.since <= 110_000
    assert rig.driver.odometry.read().vx == 0.0
    rig.base.faults.silent = False
    rig.base.outputs = 0  # it was switched off and on
    rig.run(0.1)
    assert rig.base.outputs == POWER_RAILS
    rig.run(0.5)
    assert len([event for event in rig.told if isinstance(event, Found)]) == 2
    assert len(heard(rig, RequestExtra)) == 2
    assert rig.driver.identity.complete


def test_base_control_goes_out_once_per_feedback_and_never_too_often() -> None:
    rig = Rig()
    rig.run(1.0)
    rig.base.heard.clear()
    rig.fed = 0
    rig.run(4.0, (0.1, 0.1))
    controls = heard(rig, BaseControl)
    assert rig.fed == 200
    assert len(controls) == 200
    assert len(rig.base.heard) <= 206  # and the outputs once a second


def test_the_power_rails_stay_on_whatever_the_leds_show() -> None:
    rig = Rig()
    rig.run(0.1)
    assert rig.base.outputs == POWER_RAILS
    rig.driver.light(rig.now, 1, Colour.GREEN)
    rig.driver.light(rig.now, 2, Colour.ORANGE)
    rig.run(0.1)
    assert rig.base.outputs == 0x00F0 | 0x0200 | 0x0C00
    rig.driver.light(rig.now, 2, Colour.RED)
    rig.run(0.1)
    assert rig.base.outputs == 0x00F0 | 0x0200 | 0x0400
    rig.driver.light(rig.now, 1, Colour.OFF)
    rig.base.outputs = 0  # a frame was lost, or the base switched off and on
    rig.run(1.1)
    assert rig.base.outputs == 0x00F0 | 0x0400
    assert all(c.flags & POWER_RAILS == POWER_RAILS for c in heard(rig, GeneralOutput))  # type: ignore[union-attr]


def test_sounds() -> None:
    rig = Rig()
    rig.driver.play(Melody.ERROR)
    rig.run(0.2)
    assert heard(rig, SoundSequence) == [SoundSequence(4)]


def test_sensors_that_change_are_events() -> None:
    rig = Rig()
    rig.run(0.5)
    rig.told.clear()
    rig.base.faults.buttons, rig.base.faults.charger = 2, 6
    rig.run(0.1)
    rig.base.faults.buttons = 0
    rig.run(0.1)
    changes = [(e.sense, e.before, e.now) for e in rig.told if isinstance(e, FieldChanged)]
    assert changes == [(Sense.BUTTONS, 0, 2), (Sense.CHARGER, 0, 6), (Sense.BUTTONS, 2, 0)]


def test_a_bumper_that_was_pressed_between_two_looks_is_not_missed() -> None:
    rig = Rig()
    rig.run(0.5)
    assert rig.driver.pressed() == 0
    rig.base.faults.bumper = 4
    rig.run(0.04)
    rig.base.faults.bumper = 0
    rig.run(0.04)
    assert rig.driver.pressed() == 4
    assert rig.driver.pressed() == 0


def test_the_battery_runs_down_by_levels_and_does_not_flicker() -> None:
    rig = Rig()
    for volts in (16.6, 16.4, 15.0, 14.0, 14.1, 14.2, 13.2, 13.4, 13.6, 14.4):
        rig.base.faults.battery = volts
        rig.run(0.1)
    told = [(e.volts, e.level) for e in rig.told if isinstance(e, BatteryChanged)]
    assert told == [
        (16.6, BatteryLevel.FULL),
        (15.0, BatteryLevel.FAIR),
        (14.0, BatteryLevel.LOW),
        (13.2, BatteryLevel.DANGER),
        (13.6, BatteryLevel.LOW),
        (14.4, BatteryLevel.FAIR),
    ]


def test_a_low_battery_is_shown_and_heard_and_with_a_nearly_empty_one_it_stands() -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS and heard(rig, SoundSequence) == []
    rig.base.faults.battery = 14.0
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS | Colour.ORANGE.value
    assert heard(rig, SoundSequence) == [SoundSequence(Melody.RECHARGE)]
    assert rig.body.truth().v > 0
    rig.told.clear()
    rig.base.faults.battery = 13.2
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS | Colour.RED.value
    assert len(heard(rig, SoundSequence)) == 2
    assert rig.body.truth().v == 0
    (change,) = [e for e in rig.told if isinstance(e, StopsChanged)]
    assert [stop.cause for stop in change.stops] == [HoldCause.BATTERY]
    rig.base.faults.battery = 16.0
    rig.run(1.0, (0.1, 0.0))
    assert rig.base.outputs == POWER_RAILS and rig.body.truth().v > 0


def test_why_the_base_stands_is_told_when_it_changes() -> None:
    rig = Rig()
    rig.run(1.0, (0.1, 0.0))
    rig.told.clear()
    rig.base.faults.bumper = 1
    rig.run(0.1, (0.1, 0.0))
    rig.base.faults.bumper = 0
    rig.run(0.1, (0.1, 0.0))
    changes = [e for e in rig.told if isinstance(e, StopsChanged)]
    assert [[(s.cause, s.bits) for s in e.stops] for e in changes] == [[(HoldCause.BUMPER, 1)], []]


def test_a_noisy_line_loses_frames_and_no_more() -> None:
    rig = Rig()
    rig.base.faults.scramble = 0.002
    rig.run(20.0, (0.2, 0.1))
    reception = rig.driver.reception
    assert 0.75 < reception.frames / 1000 < 0.95  # (1 - 0.002) ** 81 = 0.85
    assert reception.bad_checksum + reception.bad_length > 20
    truth = rig.body.truth().pose
    odometry = rig.driver.odometry.read()
    assert (odometry.x, odometry.y) == pytest.approx((truth.x - 10, truth.y - 10), abs=0.02)


def test_feedback_takes_its_time_on_the_wire() -> None:
    rig = Rig()
    rig.run(0.02)
    assert rig.fed == 0  # 81 bytes take 7 ms
    sizes = len(rig.base.run(Instant(22_000))), len(rig.base.run(Instant(24_000)))
    assert sizes == (23, 23)  # 11 520 bytes a second


def test_the_last_word_is_to_stand() -> None:
    assert Rig().driver.farewell() == encode_frame(bytes.fromhex("01 04 00 00 00 00"))


def test_on_a_noisy_line_stop_is_said_as_often_as_the_line_carries_it() -> None:
    rig = Rig()
    rig.run(2.0, (0.4, 0.0))
    rig.base.faults.scramble = 0.3
    rig.run(0.2, (0.4, 0.0))
    assert {stop.cause for stop in rig.driver.allowed.stops} == {HoldCause.NO_FEEDBACK, HoldCause.NOISE}
    assert rig.body.truth().v == 0.0
    before = len(rig.written)
    rig.run(0.1, (0.4, 0.0))
    assert {data for _, data in rig.written[before:]} == {rig.driver.farewell() * 5}  # in 5 ms
    rig.base.faults.scramble = 0.0
    rig.run(0.5, (0.4, 0.0))
    assert rig.driver.allowed.stops == () and rig.body.truth().v > 0.0


def test_a_silent_line_is_no_noisy_one() -> None:
    rig = Rig()
    rig.run(1.0, (0.4, 0.0))
    rig.base.faults.silent = True
    rig.run(0.3, (0.4, 0.0))
    assert {stop.cause for stop in rig.driver.allowed.stops} == {HoldCause.NO_FEEDBACK}


def test_a_base_that_does_not_hear_stop_is_told_so_150_times_a_second_until_it_stands() -> None:
    rig = Rig()
    rig.run(2.0, (0.4, 0.0))
    rig.base.faults.deaf = True
    rig.run(0.8, (0.0, 0.0))  # the ramp
    before = len(rig.written)
    rig.run(1.0, (0.0, 0.0))
    assert 95 <= len(rig.written) - before <= 150  # rounds of 5 ms: every second one
    rig.base.faults.deaf = False
    rig.run(0.5, (0.0, 0.0))
    before = len(rig.written)
    rig.run(1.0, (0.0, 0.0))
    assert 48 <= len(rig.written) - before <= 52
