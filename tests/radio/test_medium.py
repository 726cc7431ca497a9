"""The medium compared with a slow independent one, and its invariances."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.messages import Jam
from actors.radio.medium import engine
from actors.radio.medium.medium import Medium, PoissonTraffic, Request, fingerprint
from actors.radio.medium.state import BROADCAST, Cca, EventKind, Outcome, PhyParameters, Transceiver
from actors.radio.propagation import IndoorPropagation, PathLossParameters, PropagationParameters
from actors.radio.radio_model import preset
from tests.radio.plain_medium import EventRow, PlainMedium, mw
from tests.radio.swarm import STEP, Frame, Robot, Swarm, around

COUNT = 5
SECOND = 1_000_000_000
LINE_OF_SIGHT = IndoorPropagation(PropagationParameters(PathLossParameters()))
quick = settings(max_examples=150, deadline=None, derandomize=True)

places = st.lists(st.tuples(st.floats(0, 90), st.floats(0, 4)), min_size=COUNT, max_size=COUNT)
phys = st.builds(
    PhyParameters,
    noise_dbm=st.just(-95.5),
    capture_us=st.sampled_from([0, 128]),
    cochannel_penalty_db=st.sampled_from([0.0, 3.0]),
    peak_cca=st.booleans(),
    dead_us=st.sampled_from([0, 700]),
    dead_octet_us=st.sampled_from([0, 9]),
    dead_octets=st.just(50),
)
transceivers = st.lists(
    st.builds(
        Transceiver,
        address=st.just(0),
        tx_power_dbm=st.sampled_from([-10.0, 0.0]),
        cca=st.sampled_from(list(Cca)),
        sensitivity_dbm=st.sampled_from([-110.0, -95.0]),
        cca_threshold_dbm=st.sampled_from([-85.0, -69.0, -30.0]),
        min_be=st.integers(0, 3),
        max_backoffs=st.integers(0, 4),
        queue=st.integers(1, 4),
    ),
    min_size=COUNT,
    max_size=COUNT,
).map(lambda some: [replace(one, address=100 + i) for i, one in enumerate(some)])
requests = st.lists(
    st.builds(
        Request,
        instant_ns=st.integers(0, 40_000).map(lambda us: us * 1000),
        transceiver=st.integers(0, COUNT - 1),
        octets=st.integers(10, 127),
        to=st.integers(BROADCAST, COUNT - 1),
        ack=st.booleans(),
    ),
    max_size=30,
).map(
    lambda some: [r._replace(tag=k, to=(r.to if r.to != r.transceiver else -1)) for k, r in enumerate(some)]
)


class Burst:
    """One outside source with equal power everywhere."""

    def __init__(self, begin: int, end: int, dbm: float) -> None:
        self.span, self.dbm = (begin, end), dbm

    def bursts(self, since_ns: int, until_ns: int) -> NDArray[np.int64]:
        begins = since_ns <= self.span[0] < until_ns
        return np.array([self.span] if begins else [], np.int64).reshape(-1, 2)

    def has_ended(self, now_ns: int) -> bool:
        return False

    def power_dbm(self, receivers: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.full(receivers.shape[:-1], self.dbm)


def said(events: NDArray[np.void]) -> list[EventRow]:
    return [
        (int(e["instant_ns"]), int(e["kind"]), int(e["transceiver"]), int(e["other"]), int(e["tag"]))
        for e in events
    ]


NO_SENSING = [Transceiver(100 + i, cca=Cca.NEVER if i == 0 else Cca.ENERGY, queue=2) for i in range(COUNT)]
"""The first one could begin a frame of its own while it acknowledges one."""


@quick
@example(
    spots=[(0.0, 0.0)] * COUNT,
    phy=PhyParameters(noise_dbm=-95.5, capture_us=0, cochannel_penalty_db=0.0),
    transceivers=[
        replace(one, min_be=3 if i == 0 else 0, max_backoffs=0) for i, one in enumerate(NO_SENSING)
    ],
    frames=[Request(0, 0, 37, tag=0), Request(0, 1, 10, 0, ack=True, tag=1), Request(0, 0, 10, tag=2)],
    burst=None,
)
@given(
    spots=places, phy=phys, transceivers=transceivers, frames=requests,
    burst=st.none() | st.tuples(st.integers(0, 40_000), st.integers(1, 20_000), st.floats(-100, -50)),
)  # fmt: skip
def test_the_medium_equals_a_plain_model(
    spots: list[tuple[float, float]],
    phy: PhyParameters,
    transceivers: list[Transceiver],
    frames: list[Request],
    burst: tuple[int, int, float] | None,
) -> None:
    positions = np.array(spots)
    spans = [(burst[0] * 1000, (burst[0] + burst[1]) * 1000, burst[2])] if burst else []
    medium = Medium(transceivers, LINE_OF_SIGHT, phy, seed=7, interferers=[Burst(*span) for span in spans])
    medium.place(positions)
    medium.submit(frames)
    events = said(medium.run(SECOND))
    plain = PlainMedium(
        transceivers,
        LINE_OF_SIGHT.loss_db(positions, positions),
        phy,
        7,
        [(b, e, mw(p)) for b, e, p in spans],
    )
    expected = plain.play(sorted(frames, key=lambda r: (r.instant_ns, r.transceiver, r.tag)))
    assert sorted(events) == sorted(expected)
    assert medium.outcomes()[:, : Outcome.NOT_COUNTED].tolist() == [
        [counts[outcome] for outcome in Outcome if outcome != Outcome.NOT_COUNTED]
        for counts in plain.outcomes
    ]
    assert medium.pending == 0


def circling(instant_ns: int) -> NDArray[np.float64]:
    """Return positions of six transceivers on circles around places 12 m apart."""
    angle = instant_ns / 1e9 * np.arange(1, 7) / 3
    centres = np.array([[12.0 * (k % 3), 12.0 * (k // 3)] for k in range(6)])
    places: NDArray[np.float64] = centres + 5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return places


def busy_medium(extra: int = 0, moving: bool = True) -> Medium:
    """Return six transceivers, two with mutual traffic, an interferer, and silent ones."""
    transceivers = [Transceiver(10 * (k + 1), tx_power_dbm=-10.0) for k in range(6 + extra)]
    medium = Medium(transceivers, LINE_OF_SIGHT, PhyParameters(noise_dbm=-95.5), seed=3)
    silent = np.full((extra, 2), 6.0)
    medium.add(Burst(300_000_000, 420_000_000, -90.0))
    if moving:
        medium.follow(lambda instant: np.concatenate([circling(instant), silent]))
    else:
        medium.place(np.concatenate([circling(0), silent]))
    for sender in range(6):
        to = sender ^ 1 if sender < 2 else BROADCAST
        medium.offer(sender, PoissonTraffic(60 + sender, 40.0, to, acknowledged=sender < 2))
    return medium


@pytest.mark.parametrize("moving", [False, True])
def test_the_step_size_does_not_matter(moving: bool) -> None:
    def trace(step_ms: int) -> tuple[bytes, bytes]:
        medium = busy_medium(moving=moving)
        steps = range(step_ms, 1001, step_ms)
        events = np.concatenate([medium.run(step * 1_000_000) for step in steps])
        return events.tobytes(), medium.outcomes().tobytes()

    whole = trace(1000)
    assert len(whole[0]) > 50_000
    for step_ms in (1, 20, 100):
        assert trace(step_ms) == whole


def test_silent_transceivers_do_not_matter() -> None:
    alone, beside = busy_medium(), busy_medium(extra=1)
    events, more = alone.run(SECOND), beside.run(SECOND)
    others = more[more["transceiver"] < 6]
    assert others.tobytes() == events.tobytes() and len(more) > len(others)
    assert np.array_equal(beside.outcomes()[:6], alone.outcomes())


def test_the_order_of_transceivers_does_not_matter() -> None:
    def heard(order: list[int]) -> list[tuple[int, int, int]]:
        medium = Medium([Transceiver(k) for k in order], LINE_OF_SIGHT, PhyParameters(), seed=5)
        medium.place(np.array([[3.0 * k, 0.0] for k in order]))
        for number, k in enumerate(order):
            medium.offer(number, PoissonTraffic(50, 30.0 + k))
        events = medium.run(SECOND)
        events = events[events["kind"] == EventKind.HEARD]
        return sorted(
            (int(e["instant_ns"]), order[int(e["transceiver"])], order[int(e["other"])]) for e in events
        )

    assert heard([1, 2, 3, 4]) == heard([3, 1, 4, 2]) != []


FAR = np.array([[400.0 * k, 0.0] for k in range(12)])
"""Places 400 m apart."""


def far_apart(noise_dbm: float = -95.5, moving: bool = False) -> Medium:
    """Return distant transceivers that send without assessment, all at once for some ms."""
    transceivers = [
        Transceiver(1 + k, cca=Cca.NEVER, min_be=0, cca_threshold_dbm=-80.0 - k) for k in range(len(FAR))
    ]
    medium = Medium(transceivers, LINE_OF_SIGHT, PhyParameters(noise_dbm), seed=1)
    if moving:
        medium.follow(lambda _: FAR)
    else:
        medium.place(FAR)
    medium.submit(Request(k * 100_000, k, 120) for k in range(len(FAR)))
    medium.run(SECOND)
    return medium


@pytest.mark.parametrize(("noise_dbm", "moving"), [(-110.0, True), (-95.5, False), (-70.0, False)])
def test_omitted_signals_are_below_a_hundredth_of_a_decibel(noise_dbm: float, moving: bool) -> None:
    medium, powers_mw = far_apart(noise_dbm, moving), 10.0 ** (-LINE_OF_SIGHT.loss_db(FAR, FAR) / 10.0)
    left_out_mw = np.zeros(12)
    for sender in range(12):
        outcomes, found_mw = medium.frame_outcomes(sender)
        others = np.arange(12) != sender
        far = found_mw == 0.0
        np.testing.assert_allclose(found_mw[~far & others], powers_mw[sender][~far & others], rtol=1e-12)
        assert (outcomes[far] == Outcome.BELOW_SENSITIVITY).all()
        left_out_mw += np.where(far, powers_mw[sender], 0.0)
    least_mw = mw(min(noise_dbm, -91.0))  # of noise, and of what makes the channel busy
    twice = mw(3.0)  # as another frame disturbs more than noise
    worst_db = 10.0 * math.log10(1.0 + twice * left_out_mw.max() / least_mw)
    assert 0.0 < worst_db <= 0.01


def test_transceivers_out_of_range_are_counted() -> None:
    medium = Medium([Transceiver(1 + k, min_be=0) for k in range(4)], LINE_OF_SIGHT, PhyParameters())
    medium.place(np.array([[4000.0 * k, 0.0] for k in range(4)]))
    medium.switch(2, False)
    medium.submit([Request(0, 0, 120)])
    medium.run(2_000_000)  # it is in the air
    medium.switch(1, False)
    medium.switch(2, True)
    medium.run(SECOND)
    became = [Outcome.NOT_COUNTED, Outcome.POWERED_OFF, Outcome.NOT_COUNTED, Outcome.BELOW_SENSITIVITY]
    assert medium.frame_outcomes(0)[0].tolist() == became
    assert [counts.tolist() for counts in medium.outcomes()] == np.eye(len(Outcome), dtype=int)[
        became
    ].tolist()


def test_the_fingerprint_compiles_all_that_a_run_calls() -> None:
    """A variant missing here would be compiled while a swarm waits."""
    assert fingerprint() == fingerprint()
    kernels = [engine.run, engine.offer, engine.switch_on, engine.switch_off]
    compiled = [len(kernel.signatures) for kernel in kernels]
    assert min(compiled) == 1
    swarm = Swarm({"a": Robot(0.0), "b": Robot(1.0, vx=0.5)}, model=around(preset("chapter")))
    swarm.run([Frame(0, "a")], [Jam(0.0, 0.0, 1.0, 50_000)])
    swarm.change("a", powered=False)
    swarm.run([Frame(STEP, "b")])
    swarm.change("a", powered=True)
    swarm.run()
    assert [len(kernel.signatures) for kernel in kernels] == compiled
