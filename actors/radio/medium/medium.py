"""The medium shared by transceivers: frames in the air and their reception.

All instants are integers in nanoseconds. Weak frames are followed as far as they matter
(`actors.radio.medium.state.initial_state`). Results depend neither on how time is divided into calls of `run`
nor on silent transceivers: every random number is a function of a seed and of its purpose
(`actors.radio.medium.reception`).

The medium handles frames, transceivers and instants; walls, distances and shadowing belong to a
`Propagation`, Wi-Fi and jammers to an `Interferer`. Positions are (…, 2) arrays, m, map frame. Everything is
a function of its arguments and of a seed given at construction, independent of the number and order of calls.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple, Protocol

import msgspec
import numpy as np

from actors.array_types import Floats, Int64s, Octets, Records
from actors.ieee802154 import PSDU_LIMIT
from actors.radio.medium import engine
from actors.radio.medium.state import (
    BROADCAST,
    EVENT,
    REQUEST,
    SWITCH,
    ExternalInputs,
    Outcome,
    PhyParameters,
    TrafficKind,
    Transceiver,
    initial_state,
    milliwatts,
)

Trajectory = Callable[[int], Floats]
"""Positions of all transceivers, (n, 2), m, at an instant, ns; must depend on the instant only."""


class Propagation(Protocol):
    """Attenuation of signals between positions."""

    def loss_db(self, senders: Floats, receivers: Floats, most_db: float = math.inf) -> Floats:
        """Return the loss from each sender to each receiver, dB ≥ 0, `inf` = no signal: (senders, receivers).

        Where it is above `most_db`, any value above is valid, so that distant receivers need not be computed.

        `senders` (s, 2), `receivers` (r, 2). Called once per frame, with one sender, for the positions at its
        first symbol, or once per sender while all stand still: entry (i, j) must depend on these two points
        only, bit for bit. Where a sender is its own receiver, any value is valid.
        """
        ...


class Interferer(Protocol):
    """A source of interference other than an 802.15.4 transceiver; never decoded."""

    def bursts(self, since_ns: int, until_ns: int) -> Int64s:
        """Return the bursts that begin in [since, until): (bursts, 2), begin and end, ns; ordered, disjoint.

        An end may be after `until`. The division of time into windows must not change the bursts.
        """
        ...

    def power_dbm(self, receivers: Floats) -> Floats:
        """Return the power within the receivers' band during a burst, dBm: `receivers` (…, 2) → (…).

        `-inf` = no signal. Evaluated at the begin of a burst, and again every 20 ms of a longer one.
        """
        ...

    def has_ended(self, now_ns: int) -> bool:
        """Return whether no burst is on or begins at `now_ns` or later."""
        ...


class PoissonTraffic(msgspec.Struct, frozen=True):
    """Traffic of a Poisson process."""

    octets: int
    """Octets of the PSDU, including MAC header and FCS: 9 to 127."""
    per_second: float
    to: int = BROADCAST
    """Number of the receiving transceiver."""
    acknowledged: bool = False


class SaturatedTraffic(msgspec.Struct, frozen=True):
    """Saturated traffic: each frame is followed by the next."""

    octets: int
    """Octets of the PSDU, including MAC header and FCS: 9 to 127."""
    after_ns: int = 0
    """Delay of the first frame from now; different delays desynchronise transceivers."""
    to: int = BROADCAST
    acknowledged: bool = False


Traffic = PoissonTraffic | SaturatedTraffic

REFRESH_NS = 20_000_000
"""Instants at multiples of this re-evaluate the power of long bursts, as transceivers may move, ns."""

OFF = -1


class Interference:
    """Interferers with their current bursts."""

    def __init__(self) -> None:
        self._interferers: list[Interferer | None] = []
        self._ends: dict[int, int] = {}

    def __len__(self) -> int:
        """Return the number of slots."""
        return len(self._interferers)

    def add(self, interferer: Interferer) -> None:
        """Add an interferer in a free slot, or a new one."""
        if None in self._interferers:
            self._interferers[self._interferers.index(None)] = interferer
        else:
            self._interferers.append(interferer)

    def drop_ended(self, now_ns: int) -> None:
        """Remove the sources without bursts from `now_ns` on."""
        for source, interferer in enumerate(self._interferers):
            if interferer is not None and interferer.has_ended(now_ns) and source not in self._ends:
                self._interferers[source] = None

    def until(self, since_ns: int, until_ns: int, where: Trajectory) -> tuple[Records, Floats]:
        """Return the switches in [since, until), in order, and the powers, mW, of their rows."""
        entries: list[tuple[int, int, bool]] = []
        for source, interferer in enumerate(self._interferers):
            if interferer is not None:
                entries += self._entries(source, interferer, since_ns, until_ns)
        if not entries:
            return np.zeros(0, SWITCH), np.zeros((0, len(where(since_ns)) if self._interferers else 0))
        entries.sort()
        switches = np.zeros(len(entries), SWITCH)
        rows: list[Floats] = []
        for place, (instant, source, on) in enumerate(entries):
            switches[place] = (instant, source, len(rows) if on else OFF)
            interferer = self._interferers[source]
            if on and interferer is not None:
                rows.append(interferer.power_dbm(where(instant)))
        transceivers = len(where(since_ns))
        return switches, milliwatts(np.array(rows).reshape(-1, transceivers))

    def _entries(
        self, source: int, interferer: Interferer, since_ns: int, until_ns: int
    ) -> list[tuple[int, int, bool]]:
        """Return the instants at which the source goes on or off (off first)."""
        spans = [(begin, end) for begin, end in interferer.bursts(since_ns, until_ns).tolist()]
        entries = [(begin, source, True) for begin, _ in spans]
        if source in self._ends:
            spans.insert(0, (since_ns - 1, self._ends.pop(source)))
        for begin, end in spans:
            first = (begin // REFRESH_NS + 1) * REFRESH_NS
            entries += [(at, source, True) for at in range(first, min(end, until_ns), REFRESH_NS)]
            if end < until_ns:
                entries.append((end, source, False))
            else:
                self._ends[source] = end
        return entries


_NO_LOSSES: Final = np.zeros(0)
_NO_SWITCHES: Final = np.zeros(0, SWITCH)


class Request(NamedTuple):
    """A frame to give to a transceiver at a future instant."""

    instant_ns: int
    transceiver: int
    octets: int
    """Octets of the PSDU."""
    to: int = BROADCAST
    ack: bool = False
    tag: int = 0
    """Returned in the frame's events."""


class Medium:
    """Transceivers, numbered in order, and the frames between them."""

    def __init__(
        self,
        transceivers: Sequence[Transceiver],
        propagation: Propagation,
        phy: PhyParameters | None = None,
        *,
        seed: int = 0,
        interferers: Sequence[Interferer] = (),
        watched: Sequence[int] | None = None,
        keeps_outcomes: bool = False,
    ) -> None:
        """Create a medium with all transceivers on.

        `watched`: transceivers whose receptions `run` returns as events; default: all. Counters include all.
        `keeps_outcomes`: append to `sent_outcomes`.
        """
        self._propagation = propagation
        self._state = initial_state(transceivers, phy or PhyParameters(), seed, pauses=keeps_outcomes)
        self.sent_outcomes: list[tuple[Octets, Floats]] = []
        """`frame_outcomes` of each frame sent, in the order of the events; the caller clears the list."""
        none = np.zeros((0, len(transceivers)))
        self._inputs = ExternalInputs(np.zeros(0, REQUEST), _NO_SWITCHES, none, none)
        self._trajectory: Trajectory = lambda _: np.zeros((len(transceivers), 2))
        self._interference = Interference()
        for interferer in interferers:
            self.add(interferer)
        if watched is not None:
            self._state.transceivers["settings"]["watched"] = False
            self._state.transceivers["settings"]["watched"][list(watched)] = True

    @property
    def now_ns(self) -> int:
        """Current instant: everything before it has run."""
        return int(self._state.medium["now_ns"])

    @property
    def wake_ns(self) -> int | None:
        """Next instant at which a transceiver has something scheduled; None without any."""
        medium, requests = self._state.medium, self._inputs.requests
        due = [int(self._state.agenda["instant_ns"][0])] if medium["due"] else []
        due += requests["instant_ns"][medium["next_request"] :][:1].tolist()
        return min(due, default=None)

    def place(self, positions: Floats) -> None:
        """Place the transceivers at fixed positions from now on: (n, 2), m."""
        positions = np.array(positions, dtype=np.float64)
        self._trajectory = lambda _: positions
        self._state.medium["moving"] = False
        self._state.transceivers["row"] = 0

    def follow(self, trajectory: Trajectory) -> None:
        """Move the transceivers from now on; `trajectory` is called for instants within `run`."""
        self._trajectory = trajectory
        self._state.medium["moving"] = True
        self._state.transceivers["row"] = 0

    def add(self, interferer: Interferer) -> None:
        """Add a source of interference from now on; earlier bursts do not count."""
        self._interference.drop_ended(self.now_ns)
        self._interference.add(interferer)
        now_mw = self._inputs.now_mw
        if len(self._interference) > len(now_mw):
            silent = np.zeros((1, now_mw.shape[1]))
            self._inputs = self._inputs._replace(now_mw=np.concatenate([now_mw, silent]))

    def set_power(self, transceiver: int, tx_power_dbm: float) -> None:
        """Set the transmit power of the transceiver's following frames."""
        record = self._state.transceivers[transceiver]
        if record["settings"]["tx_dbm"] != tx_power_dbm:
            record["settings"]["tx_dbm"] = tx_power_dbm
            record["row"] = 0

    def offer(self, transceiver: int, traffic: Traffic) -> None:
        """Generate traffic at a transceiver from now on; its frames have the tag -1."""
        record = self._state.transceivers["traffic"][transceiver]
        record["octets"], record["to"], record["ack"] = traffic.octets, traffic.to, traffic.acknowledged
        if isinstance(traffic, PoissonTraffic):
            record["interval_ns"] = 1e9 / traffic.per_second
            engine.offer(self._state, transceiver, TrafficKind.POISSON.value, 0)
        else:
            engine.offer(self._state, transceiver, TrafficKind.SATURATED.value, traffic.after_ns)

    def submit(self, requests: Iterable[Request]) -> None:
        """Schedule frames; those of one instant in order of transceiver, then as given."""
        rows = [tuple(request) for request in requests]
        if not rows:
            return
        added = np.array(rows, REQUEST)
        done = int(self._state.medium["next_request"])
        merged = np.concatenate([self._inputs.requests[done:], added])
        order = np.lexsort((merged["transceiver"], merged["instant_ns"]))
        self._inputs = self._inputs._replace(requests=merged[order])
        self._state.medium["next_request"] = 0

    def switch(self, transceiver: int, powered: bool) -> None:
        """Switch a transceiver now. Call `finish_frames` first for frames that end now."""
        if bool(self._state.transceivers["mac"]["powered"][transceiver]) == powered:
            return
        if powered:
            engine.switch_on(self._state, transceiver)
        else:
            engine.switch_off(self._state, transceiver)

    def withhold(self, sender: int, receiver: int) -> None:
        """Drop the next frame (not acknowledgement) that the receiver would receive from the sender."""
        self._state.withheld[sender, receiver] += 1

    def finish_frames(self) -> Records:
        """End the frames whose end is now, before a switch; return events as `run`."""
        return self._advance(self.now_ns, True)

    def run(self, until_ns: int) -> Records:
        """Run everything before `until_ns`; return the events, (events,) of EVENT, in order of time."""
        if self._interference:
            switches, rows = self._interference.until(self.now_ns, until_ns, self._trajectory)
            self._inputs = self._inputs._replace(switches=switches, rows_mw=rows)
            self._state.medium["next_switch"] = 0
        return self._advance(until_ns, False)

    def counters(self) -> Records:
        """Return (n,) of COUNTERS: counts of each transceiver's frames, and of others' at it; a copy."""
        counters = self._state.transceivers["counters"].copy()
        outcomes = counters["outcomes"]
        others = outcomes.sum(axis=1, dtype=np.int64)
        outcomes[:, Outcome.BELOW_SENSITIVITY] = self._state.medium["ended"] - others
        return counters

    @property
    def airtimes_ns(self) -> list[int]:
        """Airtime of each transceiver's ended frames."""
        airtimes: list[int] = self._state.transceivers["counters"]["on_air_ns"].tolist()
        return airtimes

    def outcomes(self) -> Int64s:
        """Return (n, outcomes): outcomes of others' frames at each transceiver; a copy."""
        return self.counters()["outcomes"]

    def frame_outcomes(self, sender: int) -> tuple[Octets, Floats]:
        """Return the outcomes of the sender's last frame at all transceivers.

        (n,) of Outcome, and (n,) received powers, mW, 0 where it is not followed; copies. Valid until the
        sender's next frame begins.
        """
        return self._state.outcomes[sender].copy(), self._state.gains_mw[sender].copy()

    @property
    def busy_ns(self) -> int:
        """Total time with at least one frame in the air."""
        medium = self._state.medium
        open_ns = medium["now_ns"] - medium["busy_since_ns"] if medium["in_air"] else 0
        return int(medium["busy_ns"] + open_ns)

    @property
    def pending(self) -> int:
        """Number of frames in the air or in queues."""
        return int(self._state.transceivers["mac"]["queued"].sum(dtype=np.int64))

    def _advance(self, until_ns: int, include_ends: bool) -> Records:
        state, medium = self._state, self._state.medium
        parts: list[Records] = []
        loss_db = _NO_LOSSES
        while True:
            code = engine.run(state, self._inputs, until_ns, include_ends, loss_db)
            if code == engine.ROW:
                sender, positions = medium["sender"], self._trajectory(int(medium["now_ns"]))
                loss_db = self._propagation.loss_db(
                    positions[sender : sender + 1], positions, float(medium["most_db"])
                )[0]
                continue
            loss_db = _NO_LOSSES
            if code == engine.SENT:
                self.sent_outcomes.append(self.frame_outcomes(int(medium["sent_by"])))
                continue
            if medium["events"]:
                parts.append(state.events[: medium["events"]].copy())
                medium["events"] = 0
            if code == engine.DONE:
                return parts[0] if len(parts) == 1 else np.concatenate(parts) if parts else np.zeros(0, EVENT)


class _LinearPropagation:
    """Transceivers on a line with simple losses and interference, for the fingerprint."""

    def loss_db(self, senders: Floats, receivers: Floats, most_db: float = math.inf) -> Floats:
        return 55.0 + np.abs(senders[:, :1] - receivers[:, 0])

    def bursts(self, since_ns: int, until_ns: int) -> Int64s:
        begins = np.arange(-(-since_ns // 50_000_000), -(-until_ns // 50_000_000)) * 50_000_000
        return np.stack([begins, begins + 9_000_000], axis=1)

    def has_ended(self, now_ns: int) -> bool:
        return False

    def power_dbm(self, receivers: Floats) -> Floats:
        return -90.0 - receivers[..., 0]


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
    line = _LinearPropagation()
    row = [Transceiver(k, tx_power_dbm=-10.0, max_backoffs=k) for k in range(5)]
    medium = Medium(row, line, seed=1, interferers=[line])
    medium.follow(lambda at: np.stack([np.arange(5.0) * (4.0 + at / 1e9), np.zeros(5)], axis=1))
    for number in range(3):
        medium.offer(number, PoissonTraffic(30 + number, 60.0, (number + 1) % 3, acknowledged=number != 1))
    medium.offer(3, SaturatedTraffic(PSDU_LIMIT))
    medium.submit(Request(k * 7_000_000, 4, 20, tag=k) for k in range(100))
    events = [medium.run(200_000_000), medium.finish_frames()]
    medium.switch(3, False)
    events.append(medium.run(300_000_000))
    medium.switch(3, True)
    events.append(medium.run(400_000_000))
    return b"".join(part.tobytes() for part in events) + medium.outcomes().tobytes()
