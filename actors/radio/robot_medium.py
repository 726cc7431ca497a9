"""The medium for robots: takes frames with data and jams, returns events of transceivers."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Floats, Indices, Int64s, Octets, Records
from actors.kernels import kernel
from actors.messages import (
    TOO_WEAK,
    AccessFailure,
    FrameOutcome,
    FrameOverflow,
    FrameReceived,
    FrameSent,
    Jam,
    RadioEvent,
    RobotTruth,
)
from actors.portable import arrays, exp10
from actors.portable.compiled import cos, sin
from actors.radio.frame import link_qualities, octets, rssi_codes, strengths_dbm
from actors.radio.medium.medium import Medium, Request
from actors.radio.medium.state import EventKind, Outcome
from actors.radio.radio_model import Jammer, RadioModel, required_dbm

FRAMES: Final = {
    "frames_sent": "sent",
    "frames_cut_off": "cut_off",
    "frames_access_failure": "access_failures",
    "frames_overflowed": "overflowed",
}
"""Outcomes of frames given to a transceiver, by the medium's counter: transmitted; cut off by switching the
sender off; channel never clear; transmit queue full."""
EVENTS: Final = ("dropped", "discarded")
"""Events for a robot that is not stepping: dropped because the host's buffer is full; discarded because the
robot was switched off or restarted."""
COPIES: Final = {
    f"copies_{'' if outcome is Outcome.HEARD else 'lost_'}{outcome.name.lower()}": int(outcome)
    for outcome in Outcome
    if outcome not in (Outcome.FILTERED, Outcome.NOT_COUNTED)
}
"""Robots broadcast, so frames are never filtered."""


class FrameCounters:
    """Counters of frames, copies and events, including frames that never reached the medium."""

    def __init__(self, transceivers: int) -> None:
        self.refused = 0
        """Number of frames refused, of all robots."""
        self.discarded = np.zeros(transceivers, np.int64)
        """Frames requested while the transceiver was off, by transceiver."""
        self._events = dict.fromkeys(EVENTS, 0)

    def events(self, end: str, number: int) -> None:
        """Count events not delivered to a robot, by one of EVENTS."""
        self._events[end] += number

    def counters(self, medium: Records) -> dict[str, int]:
        """Return all counters by name, including the medium's (`Medium.counters`).

        `frames_*` count frames; `bytes_sent` the octets of transmitted ones, with MAC header and FCS;
        `copies_*` count each frame, at its end, once per other transceiver that was powered at its begin:
        with n transceivers always on, they sum up to n - 1 times `frames_sent`; `events_*` count lost events.
        """

        def total(counts: Int64s) -> int:
            return int(counts.sum(dtype=np.int64))

        frames = {name: total(medium[field]) for name, field in FRAMES.items()}
        frames["frames_refused"] = self.refused
        frames["frames_discarded"] = total(medium["discarded"]) + total(self.discarded)
        frames["bytes_sent"] = total(medium["octets_sent"])
        copies = {name: total(medium["outcomes"][:, outcome]) for name, outcome in COPIES.items()}
        return frames | copies | {f"events_{end}": count for end, count in self._events.items()}

    def by_robot(self, robots: Sequence[str], medium: Records) -> dict[str, dict[str, int]]:
        """Return the counters by robot: of its own frames, and of the copies of others' frames at it."""
        return {
            robot: {
                **{name: int(own[field]) for name, field in FRAMES.items()},
                "frames_discarded": int(own["discarded"] + self.discarded[number]),
                **{name: int(own["outcomes"][outcome]) for name, outcome in COPIES.items()},
            }
            for number, (robot, own) in enumerate(zip(robots, medium, strict=True))
        }


class TransceiverTruth:
    """Ground truth of the transceivers in one step, by number; that of an ended robot is off.

    From its pose at the step's start a robot moves along an arc, with constant speed and angular velocity.
    """

    def __init__(self, start_us: int, robots: Sequence[RobotTruth | None]) -> None:
        self._start_ns = start_us * 1000
        # lists, not generators, which cost a call per robot
        self.powered = tuple([robot is not None and robot.powered for robot in robots])
        self.epochs = tuple([robot.epoch if robot is not None else 0 for robot in robots])
        truths = [(r.x, r.y, r.vx, r.vy, r.omega) if r else (0.0, 0.0, 0.0, 0.0, 0.0) for r in robots]
        table = np.array(truths, dtype=np.float64).reshape(-1, 5)
        self.places: Floats = table[:, :2].copy()
        """Positions at the step's start, (transceivers, 2), m."""
        self._truths = table
        self.still = not table[:, 2:4].any()

    def positions(self, instant_ns: int) -> Floats:
        """Return the positions at an instant, (transceivers, 2), m."""
        elapsed = (instant_ns - self._start_ns) / 1e9
        return _moved(self._truths, elapsed)


@kernel
def _moved(truths: Floats, elapsed: float) -> Floats:
    """Return places, (n, 2) m, after `elapsed` s; truths (n, 5): place, m, velocity, m/s, its rotation,
    rad/s."""
    moved = np.empty((truths.shape[0], 2))
    for i in range(truths.shape[0]):
        x, y, omega = truths[i, 0], truths[i, 1], truths[i, 4]
        vx, vy = truths[i, 2], truths[i, 3]
        half_angle = omega * (elapsed / 2)
        cosine, sine = cos(half_angle), sin(half_angle)
        # chord of an arc: sin(h)/h of the distance driven, rotated by the half angle h
        driven = elapsed * (sine / half_angle if half_angle != 0 else 1.0)
        cosine, sine = driven * cosine, driven * sine
        moved[i, 0] = x + (vx * cosine - vy * sine)
        moved[i, 1] = y + (vx * sine + vy * cosine)
    return moved


def fingerprint() -> bytes:
    """Return the kernel's results for fixed inputs, which differ if a processor computes differently."""
    robots = []
    for k in range(5):
        state = 0.3 * k, 2.0 - k, 0.0, 0.1 * k, 0.4, 0.2 * k - 0.4
        robots.append(RobotTruth(f"r{k}", *state, stepping=True, powered=True, transmits=0))
    return TransceiverTruth(0, robots).positions(73_000_001).tobytes()


_HEARD: Final = int(EventKind.HEARD)
_READ: Final = "instant_ns", "kind", "transceiver", "other", "tag"
_END_EVENTS: Final = {
    int(EventKind.SENT): (FrameSent, "sent"),
    int(EventKind.ACCESS_FAILURE): (AccessFailure, "access_failure"),
    int(EventKind.OVERFLOW): (FrameOverflow, "overflow"),
}


class SubmittedFrame(NamedTuple):
    """A frame of valid size that a robot gives to its transceiver."""

    instant: int
    """Instant, µs."""
    transceiver: int
    """Number of the transceiver on the medium."""
    tag: int
    data: bytes


def _copies(
    sent: Sequence[tuple[Octets, Floats]], senders: Sequence[int]
) -> list[tuple[bytes, bytes, bytes]]:
    """Return the last three fields of FrameOutcome for transmitted frames with their outcomes."""
    if not sent:
        return []
    outcomes = np.array([row for row, _ in sent])
    powers_mw = np.array([row for _, row in sent])
    listed = (outcomes != Outcome.BELOW_SENSITIVITY) | (powers_mw > 0.0)
    listed[np.arange(len(sent)), senders] = False
    powers = powers_mw[listed]
    tenths = np.full(powers.shape, TOO_WEAK, "<i2")
    tenths[powers > 0.0] = np.rint(100.0 * arrays.log10(powers[powers > 0.0]))
    rows, receivers = np.nonzero(listed)
    bounds = np.searchsorted(rows, np.arange(len(sent) + 1)).tolist()
    parts = receivers.astype("<u2").tobytes(), outcomes[listed].tobytes(), tenths.tobytes()
    return [
        (parts[0][2 * begin : 2 * end], parts[1][begin:end], parts[2][2 * begin : 2 * end])
        for begin, end in pairwise(bounds)
    ]


Notices = list[list[RadioEvent]]
"""Events for each robot, by transceiver number, in order of time."""


class RobotMedium:
    """All transceivers and their frames; stores the frames' data, of which the medium knows only the size."""

    def __init__(
        self, addresses: Sequence[int], model: RadioModel, seed: int, *, keeps_outcomes: bool = False
    ) -> None:
        """Create the medium; `keeps_outcomes`: collect frame outcomes for `take_outcomes`."""
        parameters = model.parameters
        self._addresses = tuple(addresses)
        self._noise_mw = exp10(parameters.phy.noise_dbm / 10.0)
        self._weakest_dbm = required_dbm(parameters)
        self.medium = Medium(
            [parameters.transceiver.numbered(address) for address in addresses],
            model.propagation,
            parameters.phy,
            seed=seed,
            interferers=model.interferers,
            keeps_outcomes=keeps_outcomes,
        )
        self._keeps_outcomes = keeps_outcomes
        self._ended: list[tuple[SubmittedFrame, int, str]] = []
        """Ended frames with end time, µs, and result, until `take_outcomes`."""
        self._powered = (True,) * len(self._addresses)
        self._epochs: tuple[int, ...] | None = None
        self.discarded = 0
        """Number of notices discarded because their epoch had ended."""
        self._last_places: Floats | None = None
        # By transceiver and medium tag, as robots' own tags need not be unique.
        self._frames: list[dict[int, SubmittedFrame]] = [{} for _ in self._addresses]
        self._serial = 0

    def advance(
        self, truth: TransceiverTruth, jams: Sequence[Jam], frames: Iterable[SubmittedFrame], until: int
    ) -> Notices:
        """Return the transceivers' events from the step's start up to `until`, µs, exclusive.

        The transceivers of `frames` must be on. Events of an earlier epoch are discarded.
        """
        notices: Notices = [[] for _ in self._addresses]
        if truth.powered != self._powered or truth.epochs != self._epochs:
            restarted = self._restarted_transceivers(truth.epochs)
            self._record_events(self.medium.finish_frames(), notices)
            for number in restarted:
                self.discarded += len(notices[number])
                notices[number].clear()
            self._switch_power(truth.powered, restarted)
        self._move(truth)
        now_ns = self.medium.now_ns
        for jam in jams:
            self.medium.add(Jammer(jam.x, jam.y, jam.radius, now_ns, jam.until * 1000))
        self.medium.submit([self._request(frame) for frame in frames])
        self._record_events(self.medium.run(until * 1000), notices)
        return notices

    def take_outcomes(self) -> tuple[FrameOutcome, ...]:
        """Return the outcome of each frame that has ended since the last call, in order of time."""
        ended, self._ended = self._ended, []
        senders = [frame.transceiver for frame, _, end in ended if end == "sent"]
        copies = iter(_copies(self.medium.sent_outcomes, senders))
        self.medium.sent_outcomes.clear()
        return tuple(
            FrameOutcome(
                frame.transceiver, frame.tag, frame.instant, instant, len(frame.data), end,
                *(next(copies) if end == "sent" else (b"", b"", b"")),
            )
            for frame, instant, end in ended
        )  # fmt: skip

    def _request(self, frame: SubmittedFrame) -> Request:
        self._serial += 1
        self._frames[frame.transceiver][self._serial] = frame
        return Request(frame.instant * 1000, frame.transceiver, octets(len(frame.data)), tag=self._serial)

    def _restarted_transceivers(self, epochs: tuple[int, ...]) -> frozenset[int]:
        """Return the transceivers whose epoch has changed since the last step."""
        before, self._epochs = self._epochs or epochs, epochs
        return frozenset(
            number for number, (was, now) in enumerate(zip(before, epochs, strict=True)) if was != now
        )

    def _switch_power(self, powered: tuple[bool, ...], restarted: frozenset[int]) -> None:
        """Switch transceivers on and off; a restart switches off and on, and clears all state."""
        for number, (was, on) in enumerate(zip(self._powered, powered, strict=True)):
            off = was and (not on or number in restarted)
            if off:
                self.medium.switch(number, False)
                self._frames[number].clear()
            if on and (off or not was):
                self.medium.switch(number, True)
        self._powered = powered

    def _move(self, truth: TransceiverTruth) -> None:
        if not truth.still:
            self._last_places = None
            self.medium.follow(truth.positions)
        elif self._last_places is None or not np.array_equal(self._last_places, truth.places):
            self._last_places = truth.places
            self.medium.place(truth.places)

    def _record_events(self, events: Records, notices: Notices) -> None:
        if not events.size:
            return
        strengths, qualities = self._quality(events["power_mw"], events["sinr"])
        addresses, frames = self._addresses, self._frames
        columns = [events[name].tolist() for name in _READ]
        rows = zip(*columns, strengths.tolist(), qualities.tolist(), strict=True)
        for instant_ns, kind, number, sender, serial, strength, quality in rows:
            instant = instant_ns // 1000
            if kind == _HEARD:
                data = frames[sender][serial].data
                notices[number] += (FrameReceived(instant, addresses[sender], strength, quality, data),)
            else:
                event_type, end = _END_EVENTS[kind]
                frame = frames[number].pop(serial)
                notices[number] += (event_type(instant, frame.tag),)
                if self._keeps_outcomes:
                    self._ended.append((frame, instant, end))

    def _quality(self, power_mw: Floats, sinr: Floats) -> tuple[Floats, Indices]:
        """Return signal strengths, dBm, and link qualities, limited to the chip's codes; (n,) each.

        Interference lowers the quality like an equally weaker signal. Not meaningful for events other than
        receptions.
        """
        strengths = strengths_dbm(rssi_codes(10.0 * arrays.log10(power_mw)))
        equivalent_dbm = 10.0 * arrays.log10(np.minimum(power_mw, sinr * self._noise_mw))
        return strengths, link_qualities(equivalent_dbm, self._weakest_dbm)
