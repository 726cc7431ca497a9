"""Robots without radio boards: the simulated medium of another computer, links to it, certificates."""

import math
import signal
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest
import zenoh

from actors.instant import Instant, milliseconds, seconds
from actors.messages import (
    DRIVE,
    FRAME_OUTCOMES,
    RECEIVED,
    TRANSMIT,
    TRUTH,
    Drive,
    FrameOutcome,
    FrameOutcomes,
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameSent,
    FrameUnconfirmed,
    LinkState,
    Odometry,
    RobotTruth,
    Truth,
)
from actors.radio.frame import airtime_us
from actors.radio.radio_model import RadioSetup
from actors.runtime.codec import decode
from actors.runtime.core import at
from actors.runtime.isolation import credentials
from actors.runtime.isolation.tls import (
    CERTIFICATE_FILE,
    RADIO_STATION,
    listening_router_config,
    load_keys,
    medium_client_config,
)
from actors.runtime.recording import Note, read_recording
from actors.runtime.zenoh_bus import SelectableBus
from deploy.fleet import doctor, hardware_in_the_loop, units
from deploy.fleet.fleet_file import Fleet, load_fleet
from deploy.fleet.keys import create_keys, replace_keys
from deploy.fleet.onboard_processes import OnboardRobot
from deploy.fleet.radio_station import POSITION_TIMEOUT, MediumCore
from deploy.hosts import certificates
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.scenario_file import load_scenario
from firmware_bridge.beeclick.answer_decoder import BoardEvent
from firmware_bridge.device_lines import (
    MAX_UNSETTLED,
    SimulatedTransceiver,
    TransceiverInput,
    TransceiverLink,
)
from firmware_bridge.onboard.base_core import ESTIMATE_TIMEOUT
from firmware_bridge.onboard.bridge import BridgeCore, NetworkPort
from tests import helpers
from tests.fleet.fleet_texts import ROOT
from tests.onboard.test_base_core import STEP, BaseHarness, first_step
from tests.swarm.command import leftovers, processes_of, start

CORRIDOR = str(ROOT / "maps" / "corridor.yaml")
Place = tuple[float, float]
HERE, NEAR, FAR, OUTSIDE = (9.0, 12.5), (12.0, 12.5), (23.0, 12.5), (9.0, 1e5)
POLL = milliseconds(1)


class NetworkedRobot:
    """Bridge of a robot, whose place and network the test changes."""

    def __init__(self, name: str, place: Place | None, device: SimulatedTransceiver) -> None:
        self.name, self.place, self.device = name, place, device
        self.link = TransceiverLink()
        self.link.connect(Instant(0))
        self.bridge = BridgeCore(name, self.link)
        self.online = True
        self.events: list[BoardEvent] = []

    def serve(self, now: Instant) -> None:
        if not now % STEP and self.place is not None:
            self.link.position = self.place
        answer, line = self.device.run(now), self.link.due(now)
        if self.online:
            self.events += self.link.take(now, answer)
            self.device.take(now, line)
        elif self.link.is_silent(now):
            self.events += self.link.lost(now)

    def send(self, now: Instant, *tags: int, size: int = 100) -> None:
        for tag in tags:
            self.events += self.link.send(now, tag, bytes([tag % 256]) * size)

    def of(self, *kinds: type[BoardEvent]) -> list[BoardEvent]:
        return [event for event in self.events if isinstance(event, kinds)]


class NetworkedRoom:
    """Robots on one medium in virtual time."""

    def __init__(self, *places: Place | None) -> None:
        addresses = tuple((f"r{number}", number) for number in range(1, len(places) + 1))
        setup = RadioSetup(
            seed=1, step_us=STEP, robots=addresses, map=CORRIDOR, shadowing_db=0.0, channel=15, detail="full"
        )
        self.said: list[str] = []
        self.medium, self.now = MediumCore(setup, self.said.append), Instant(0)
        self.outcomes: list[FrameOutcome] = []
        devices = self.medium.robots
        self.robots = [
            NetworkedRobot(name, place, devices[name])
            for (name, _), place in zip(addresses, places, strict=True)
        ]
        self.run(0.2)

    def run(self, duration_s: float) -> None:
        until = self.now + seconds(duration_s)
        while self.now < until:
            self.now = self.medium.now = Instant(self.now + POLL)
            for output in self.medium.advance({}):
                assert output.address.topic is FRAME_OUTCOMES and isinstance(output.message, FrameOutcomes)
                self.outcomes += output.message.frames
            for robot in self.robots:
                robot.serve(self.now)


def test_frames_are_heard_within_reach_after_their_airtime_and_not_beyond() -> None:
    room = NetworkedRoom(HERE, NEAR, FAR)
    first, near, far = room.robots
    begun = room.now
    first.send(room.now, 1)
    room.run(0.1)
    (heard,) = near.of(FrameReceived)
    assert isinstance(heard, FrameReceived) and (heard.sender, heard.data) == (1, b"\1" * 100)
    assert airtime_us(100) < heard.instant - begun < airtime_us(100) + 5_000, (
        "CSMA/CA, and the lines' polling"
    )
    assert far.of(FrameReceived) == [] and first.of(FrameSent) != []
    (outcome,) = room.outcomes
    assert (outcome.sender, outcome.tag, outcome.size, outcome.end) == (0, 1, 100, "sent")
    near.place = FAR
    room.run(0.2)
    first.send(room.now, 2)
    room.run(0.1)
    assert len(near.of(FrameReceived)) == 1, "it has driven out of reach"
    assert first.link.round_trips_ms.total() > 0 and max(first.link.round_trips_ms) <= 2


def test_robots_share_the_air_time() -> None:
    room = NetworkedRoom(HERE, NEAR, (10.5, 12.5))
    first, second, listener = room.robots
    begun = room.now
    first.send(room.now, *range(1, 5))
    second.send(room.now, *range(1, 5))
    room.run(0.3)
    ends = [event.instant for robot in (first, second) for event in robot.of(FrameSent)]
    assert len(ends) == 8 and max(ends) - begun > 8 * airtime_us(100) * 0.9, "two at once collide at most"
    counts = room.medium.outcome()["frames"]
    assert isinstance(counts, dict) and counts["frames_sent"] == 8
    lost = sum(counts[name] for name in counts if name.startswith("copies_lost"))
    assert counts["copies_heard"] + lost == 16 and len(listener.of(FrameReceived)) >= 4


@pytest.mark.parametrize("place", [None, OUTSIDE])
def test_without_a_recent_position_on_the_map_a_robot_neither_sends_nor_receives(place: Place | None) -> None:
    room = NetworkedRoom(HERE, NEAR)
    first, second = room.robots
    assert room.said[2:] == ["r1 is on the medium", "r2 is on the medium"]
    second.place = place
    room.run(POSITION_TIMEOUT / 1e6 + 0.1)
    assert room.said[4:] == ["r2 is off the medium"]
    first.send(room.now, 1)
    second.send(room.now, 2, 3)
    room.run(0.1)
    refusals = second.of(FrameRefused)
    assert [(event.tag, event.reason) for event in refusals if isinstance(event, FrameRefused)] == [
        (tag, "The medium has no recent position of the robot on the map.") for tag in (2, 3)
    ]
    assert first.of(FrameReceived) == second.of(FrameReceived) == []
    assert room.medium.outcome()["refused_frames"] == {"r1": 0, "r2": 2}
    second.place = NEAR
    room.run(0.2)
    second.send(room.now, 4)
    room.run(0.1)
    assert len(first.of(FrameReceived)) == 1 and room.said[-1] == "r2 is on the medium"


def test_frames_accepted_before_the_timeout_of_a_position_are_settled() -> None:
    room = NetworkedRoom(HERE, NEAR)
    first, _ = room.robots
    first.place = None
    while not first.device.fault:
        first.send(room.now, room.now // 1000)
        room.run(0.012)
    room.run(0.2)
    ended = [event for event in first.events if isinstance(event, FrameSent | FrameRefused)]
    assert (
        len({event.tag for event in ended}) == len(ended) > 100
        and first.link._in_flight == []
        and first.device.channel < 0
    )


def test_a_link_that_is_lost_settles_all_frames_and_returns() -> None:
    room = NetworkedRoom(HERE, NEAR)
    first, second = room.robots
    assert first.of(LinkState) == [LinkState(first.events[0].instant, True, "")]
    first.online = False
    first.send(room.now, 1, 2)
    room.run(2.2)
    assert [type(event) for event in first.events[1:]] == [LinkState, FrameUnconfirmed, FrameUnconfirmed]
    assert room.said[-1] == "r1 is off the medium"
    first.send(room.now, 3)
    assert isinstance(first.events[-1], FrameOverflow)
    first.online = True
    first.link.connect(room.now)
    room.run(0.2)
    first.send(room.now, 4)
    room.run(0.1)
    ups = [event.up for event in first.of(LinkState) if isinstance(event, LinkState)]
    assert ups == [True, False, True] and len(second.of(FrameReceived)) == 1


def test_frames_of_lost_lines_are_unconfirmed_while_the_link_lasts() -> None:
    room = NetworkedRoom(HERE)
    (first,) = room.robots
    first.send(room.now, 1, 2)
    assert first.link.due(room.now), "a line that the network loses"
    room.run(1.9)
    assert first.of(FrameUnconfirmed) == []
    room.run(2.3)
    lost = [event.tag for event in first.events if isinstance(event, FrameUnconfirmed)]
    assert lost == [1, 2] and first.link._in_flight == [] and len(first.of(LinkState)) == 1


def test_frames_beyond_the_queues_overflow_and_are_counted() -> None:
    room = NetworkedRoom(HERE)
    (first,) = room.robots
    first.send(room.now, *range(MAX_UNSETTLED + 3))
    assert len(first.of(FrameOverflow)) == 3
    room.run(0.5)
    ended = first.of(FrameSent, FrameOverflow)
    assert len(ended) == MAX_UNSETTLED + 3, "the transceiver's queue holds eight"
    assert 8 <= len(first.of(FrameSent)) <= 10 and first.link._in_flight == []


def output(events: Sequence[object], sent: int, session: int = 0) -> bytes:
    return msgspec.json.encode([session, events, sent]) + b"\n"


def test_a_medium_that_lies_cannot_harm_the_bridge() -> None:
    link, now = TransceiverLink(), Instant(1_000_000)
    link.connect(Instant(0))
    link.take(now, output([], 500_000))
    link.send(now, 7, b"frame")
    link.due(now)
    heard = ["heard", 0, 2, -60.0, 200, "AAAA"]
    cases = [
        b"\xff\x00{[\n",
        b"[" * 100_000 + b"\n",
        output([["heard", 0, 10**40, -60.0, 200, "AAAA"]], 0),
        output([["heard", 0, 2, -60.0, 200, "A" * 4000]], 0),
        output([["refused", 0, 7, "because " * 1000]], 0),
        output([["unconfirmed", 0, 7]], 0),
        output([["sent", 0, 8]], 0),  # never sent
        output([heard], 0, session=5),
        output([heard], 2_000_000)[:-2] + b"\n",
        b'[0,[["heard",0,2,NaN,200,"AAAA"]],0]\n',
    ]
    assert [event for case in cases for event in link.take(now, case)] == []
    assert link.counters["bad_lines"] == 4 and link.counters["invalid_events"] == 4
    assert link.round_trips_ms == {500: 1}, "neither a repeated nor a future time"
    link.take(now, output([], 500_000) + output([], 2_000_000))
    assert link.round_trips_ms == {500: 1}
    (received, sent) = link.take(now, output([heard, ["sent", 0, 7]], 0))
    assert received == FrameReceived(now, 2, -60.0, 200, bytes(3)) and sent == FrameSent(now, 7)
    assert not link.is_silent(now) and link.is_silent(Instant(now + seconds(2)))


def line(*frames: tuple[object, ...], position: object = HERE, session: int = 1) -> bytes:
    return msgspec.json.encode([session, frames, 5, position]) + b"\n"


def test_a_robot_that_lies_cannot_harm_the_medium() -> None:
    room = NetworkedRoom(HERE, NEAR)
    first, second = room.robots
    device = second.device
    for case in (
        b"\x00\xff\n",
        line(*[(tag, 0, "AAAA") for tag in range(MAX_UNSETTLED + 1)]),
        line(position=(1e300, 0.0)),
        line(position=("a", 0.0)),
        line((1, "now", "AAAA")),
    ):
        device.take(room.now, case)
    assert room.medium.outcome()["invalid_lines"] == {"r1": 0, "r2": 5}
    device.take(room.now, line((10**30, 10**30, "AAAA"), (-1, 0, ""), (3, 0, "A" * 400), session=10**30))
    room.run(0.05)
    assert device.refused == 1 and first.of(FrameReceived) == []
    for _ in range(50):  # a flood, from which the queue of the medium protects others
        device.take(room.now, line(*[(tag, 0, "AAAA") for tag in range(MAX_UNSETTLED)]))
    begun = time.monotonic()
    first.send(room.now, 1)
    room.run(0.3)
    assert time.monotonic() - begun < 5 and len(first.of(FrameSent)) == 1


def test_the_base_passes_on_estimates_moved_by_odometry_while_they_are_recent() -> None:
    stage = BaseHarness()
    first_step(stage)
    stage.at(2 * STEP)
    stage.aired(2 * STEP + 1_000, 1)
    moved = Drive(2, 0.1, 0.0, 0.0, 0, pose=(20.0, 12.0, math.pi / 2))
    stage.at(2 * STEP + 2_000, at(DRIVE, "r1"), moved)
    stage.vehicle.odometry = lambda: Odometry(1.0 + 0.3, 2.0, 0.5, 0.1, 0.0, 0.2)  # type: ignore[method-assign]
    (truth,) = stage.at(3 * STEP)
    assert isinstance(truth, Truth)
    (here,) = truth.robots
    x, y = 20.0 + 0.3 * math.sin(0.5), 12.0 + 0.3 * math.cos(0.5)  # of 0.3 m along the odometry's x axis
    assert (here.x, here.y) == pytest.approx((x, y)) and here.stepping
    stage.aired(3 * STEP + 1_000, 2)
    stage.drive(3 * STEP + 2_000, 3)
    late = 2 * STEP + 2_000 + ESTIMATE_TIMEOUT
    (truth,) = stage.at(late - late % STEP + STEP)
    assert isinstance(truth, Truth) and not truth.robots[0].stepping


def test_the_bridge_reports_recent_positions_only() -> None:
    link = TransceiverLink()
    bridge = BridgeCore("r1", link)
    link.connect(Instant(0))
    for number, stepping in enumerate((True, False)):
        here = RobotTruth("r1", *HERE, 0.0, 0.0, 0.0, 0.0, stepping, True, 0)
        bridge.now = Instant(number * STEP)
        bridge.expect(TRUTH.key())
        bridge.advance({TRUTH.key(): Truth(number, bridge.now, (here,))})
        sent = msgspec.json.decode(bridge.due(), type=TransceiverInput)
        assert (sent.sent, sent.position) == (number * STEP, HERE if stepping else None)
        assert bridge.due() == b"", "ten lines per second"


FLEET = """
map = "{map}"
[radio]
network = "tls/127.0.0.1:{port}"
"""
ROBOT = """
[[robot]]
id = "r{0}"
address = {0}
start = [9.0, 12.5, 0.0]
places = []
base = "/dev/kobuki"
radio = "network"
"""


@pytest.fixture(scope="module")
def networked(tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    """Return a fleet of two robots without boards, with keys."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    file = tmp_path_factory.mktemp("fleet") / "fleet.toml"
    file.write_text(FLEET.format(map=CORRIDOR, port=port) + ROBOT.format(1) + ROBOT.format(2))
    found = load_fleet(file)
    create_keys(found, Path(found.keys), {}, now=datetime.now(UTC), days=1)
    return found


def test_a_fleet_without_boards_has_keys_for_the_medium(networked: Fleet) -> None:
    station = certificates.load_certificate(
        (networked.key_folder(RADIO_STATION) / CERTIFICATE_FILE).read_bytes()
    )
    assert (certificates.common_name(station), certificates.host_names(station)) == ("radio", ("127.0.0.1",))
    assert not (networked.key_folder(RADIO_STATION) / credentials.PACKET_KEY_FILE).exists()
    _, replaced = replace_keys(networked, Path(networked.keys), ["radio"], {}, now=datetime.now(UTC), days=1)
    assert replaced.is_dir(), "a lost computer's keys can be replaced"
    assert {path.name for path in Path(networked.keys).iterdir()} >= {"r1", "r2", "radio", "operator"}
    port = [one for one in units.unassigned(networked.robots[0], ()) if "BEE" in one]
    assert port == [] and networked.robots[0].needs_keys


def test_a_robot_neither_sends_nor_receives_as_another(networked: Fleet, tmp_path: Path) -> None:
    endpoint = str(networked.radio.network)
    robots = {name: load_keys(networked.key_folder(name)) for name in ("r1", "r2")}
    with zenoh.open(medium_client_config(robots["r1"], endpoint)) as early:  # before the medium
        issued = credentials.issue({}, tmp_path, ())
        station = load_keys(networked.key_folder(RADIO_STATION))
        with zenoh.open(listening_router_config(issued, station, [endpoint], [*robots])) as router:
            medium = SelectableBus(router, [at(TRANSMIT, name) for name in robots])
            port, spy = (
                NetworkPort("r1", early),
                early.declare_subscriber("**", zenoh.handlers.FifoChannel(10_000)),
            )
            heard: list[tuple[str, bytes]] = []

            def exchanged() -> bool:
                early.put(TRANSMIT.key("r2"), b"forged")
                early.put(RECEIVED.key("r2"), b"forged")
                port.write(b"own")
                router.put(RECEIVED.key("r2"), b"for r2")
                router.put(RECEIVED.key("r1"), b"for r1")
                heard.extend((one.key, one.payload) for one in medium.take())
                return bool(heard) and b"for r1" in port.read()

            helpers.until(exchanged, 20.0, 0.05)
            assert set(heard) == {(TRANSMIT.key("r1"), b"own")}
            own = {TRANSMIT.key("r1"), TRANSMIT.key("r2"), RECEIVED.key("r2")}  # its own loopback
            received = [(str(one.key_expr), one.payload.to_bytes()) for one in iter(spy.try_recv, None)]
            assert (RECEIVED.key("r2"), b"for r2") not in received and {key for key, _ in received} >= own
            found = doctor.run_check("radio", doctor.check_network_radio, networked, networked.robots[1])
            assert (found.ok, found.text) == (True, f"{endpoint} accepts r2")
            stranger = load_fleet(networked.path)
            stranger = msgspec.structs.replace(stranger, keys=str(tmp_path / "other"))
            create_keys(stranger, Path(stranger.keys), {}, now=datetime.now(UTC), days=1)
            found = doctor.run_check("radio", doctor.check_network_radio, stranger, stranger.robots[0])
            assert (found.ok, found.text) == (
                False,
                f"{endpoint}: its certificate is rejected: unable to get local issuer certificate; set both "
                "clocks, and give both computers the folders of one `acrc fleet keys`",
            )
    found = doctor.run_check("radio", doctor.check_network_radio, networked, networked.robots[0])
    assert found.text == f"{endpoint}: connection refused; run `acrc fleet radio fleet.toml` on that computer"


def timed(work: Callable[[], object]) -> float:
    begun = time.monotonic()
    work()
    return time.monotonic() - begun


SCENARIO = f"""
map = "{CORRIDOR}"
[run]
duration = 80.0
strategy = "chapter"
[robots]
count = 2
[[robot]]
id = "r1"
start = [9.0, 12.5, 0.0]
places = [[12.5, 12.5]]
[[robot]]
id = "r2"
start = [14.0, 12.5, 3.14]
places = [[11.0, 12.5]]
"""


@pytest.mark.nightly
@pytest.mark.timeout(240)
def test_two_robots_adapt_to_each_other_over_the_network(
    networked: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bases and lidars are emulated, and the medium is a process of its own."""
    own_port = hardware_in_the_loop._onboard_robot

    def without_port(plan: RunPlan, index: int, folder: Path, *, board: bool) -> OnboardRobot:
        robot = own_port(plan, index, folder, board=False)
        keys = str(networked.key_folder(robot.robot.id))
        ports = robot.ports._replace(radio=str(networked.radio.network), keys=keys)
        return replace(robot, ports=ports)

    monkeypatch.setattr(hardware_in_the_loop, "_onboard_robot", without_port)
    (file := tmp_path / "near.toml").write_text(SCENARIO)
    out, recording = tmp_path / "out", tmp_path / "medium"
    medium = start("fleet", "radio", networked.path, "--out", recording, "--json")
    try:
        options = RunOptions(out, hardware=True, json=True)
        result = hardware_in_the_loop.run(load_scenario(file), options)
        config = medium_client_config(load_keys(networked.key_folder("r1")), str(networked.radio.network))
        with zenoh.open(config) as session:
            port = NetworkPort("r1", session)

            def is_answered() -> bool:
                port.write(line())
                return bool(port.read())

            helpers.until(is_answered, 20.0, 0.05)
            medium.send_signal(signal.SIGSTOP)
            longest = max(timed(lambda: port.write(bytes(1500))) for _ in range(20_000))
            medium.send_signal(signal.SIGCONT)
        assert longest < 0.5, (
            "a medium that does not read blocks the bridge for 20 ms, and then is disconnected"
        )
    finally:
        medium.send_signal(signal.SIGCONT)
        medium.send_signal(signal.SIGINT)
        told, log = medium.communicate(timeout=60)
    assert medium.returncode == 0 and "r2 is on the medium" in log, log
    counters = msgspec.json.decode(told)
    assert counters["refused_frames"] == {"r1": 0, "r2": 0}
    frames = {name: one.frames for name, one in result.per_robot.items()}
    assert all(one["copies_heard"] > 0 for one in counters["frames_by_robot"].values()), frames
    assert result.deeco.counters["memberships"] > 0, "they exchange knowledge in an ensemble"
    for name, one in result.per_robot.items():
        assert one.round_trip_p50_ms is not None and one.round_trip_p99_ms is not None, name
        assert 0 <= one.round_trip_p50_ms <= one.round_trip_p99_ms < 2000
    (note,) = (one for one in result.notes if "simulated over a network" in one)
    assert note.startswith("r1, r2: the radio was simulated")
    outcomes = [
        frame
        for item in read_recording(recording / "radio.mcap")
        if not isinstance(item, Note) and item.payload is not None
        for frame in decode(FRAME_OUTCOMES, item.key, item.payload).frames  # type: ignore
    ]
    assert len(outcomes) == counters["frames"]["frames_sent"], "each frame is recorded with its receivers"
    assert processes_of(out) == [] and leftovers(tmp_path) == []
