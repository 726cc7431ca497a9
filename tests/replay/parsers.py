"""All parsers of bytes from outside, with valid bytes of each."""

import shutil
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from acrc_testbed.recordings.record_check import check_run
from acrc_testbed.results.field_recordings import read_field_trial
from acrc_testbed.results.field_trial_result import read_ground_truth
from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY, SHIPPED
from actors.instant import START
from actors.messages import TOPICS, TRANSMIT, ProcessOrder, Transmit
from actors.processes.launcher import Program
from actors.radio import program as radio
from actors.robot.program import load_setup
from actors.robot_model import load_model
from actors.runtime import typed_json
from actors.runtime.codec import decode
from actors.runtime.failure import FailureNote
from actors.runtime.isolation import credentials
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import Entry, decode_note, read_notes, read_recording
from actors.runtime.replay_bus import topic_of
from actors.world import program as world
from deeco.fragments import Reassembly
from deeco.packet import Unpacker
from deploy.fleet.fleet_file import load_fleet
from deploy.run import plan, swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.scenario_file import Overrides, load_scenario
from firmware_bridge.beeclick import board_messages as board_wire
from firmware_bridge.beeclick.answer_decoder import AnswerReader, parse_rmc
from firmware_bridge.beeclick.board_messages import NoiseError, PacketConfirmation, ReceivedPacket, SyncAnswer
from firmware_bridge.kobuki.kobuki_packets import (
    BaseControl,
    FrameReader,
    InertialSensorData,
    MalformedError,
    UnknownPacket,
    decode_commands,
    decode_feedback,
    encode_command,
    encode_feedback,
    encode_frame,
)
from firmware_bridge.range_sensors.rplidar import Sample, SampleReader

T = TypeVar("T")


@dataclass(frozen=True)
class Parser:
    """A function that reads bytes; it may raise AcrcError and nothing else."""

    name: str
    seeds: tuple[bytes, ...]
    parse: Callable[[bytes], object]


def parsers(scratch: Path, run: Path) -> Iterator[Parser]:
    """Yield all parsers; `scratch` is an empty folder, `run` the folder of a run."""
    out = shutil.copytree(run, scratch / "run")
    scenario = load_scenario(SHIPPED / "scenarios" / "head_on.toml", Overrides(duration=3.0))
    planned = swarm.plan(scenario, RunOptions(scratch / "planned", bus="memory"))
    yield from _messages(out)
    yield from _recordings(out)
    yield from _files(out, scratch)
    yield from _setups(planned, scratch)
    yield from (Parser(*one) for one in device_parsers())


def _messages(out: Path) -> Iterator[Parser]:
    payloads = defaultdict[str, list[bytes]](list)
    for path in sorted(out.glob("*/*.mcap")):
        for item in read_recording(path):
            if isinstance(item, Entry) and item.payload is not None:
                payloads[topic_of(item.key).pattern].append(item.payload)
    for topic in TOPICS:
        seeds = tuple(payloads[topic.pattern][:200]) or (b"\x93\x00\x00\x00",)
        yield Parser(f"{topic.kind.__name__} on {topic.pattern}", seeds, _decoder(topic))
    sent = [decode(TRANSMIT, "", payload) for payload in payloads[TRANSMIT.pattern]]  # type: ignore[arg-type]
    frames = tuple(frame.data for one in sent if isinstance(one, Transmit) for frame in one.frames)
    yield Parser("frames of fragments", frames, lambda data: Reassembly().take(START, 1, data))
    packets = tuple(packet for frame in frames for packet in Reassembly().take(START, 1, frame))
    yield Parser("packets of knowledge", packets or frames, Unpacker().unpack)


def _recordings(out: Path) -> Iterator[Parser]:
    path = out / "r1" / "r1.mcap"
    sound = path.read_bytes()
    notes = read_notes(path)

    def in_its_place(data: bytes) -> None:
        path.write_bytes(data)
        try:
            check_run(out)
        finally:
            path.write_bytes(sound)

    def collected(data: bytes) -> None:
        path.write_bytes(data)
        try:
            read_field_trial([out])
        finally:
            path.write_bytes(sound)

    yield Parser("recording, checked", (sound,), in_its_place)
    yield Parser("recording, collected", (sound,), collected)
    for name, kind in (("run", RunNote), ("final", FinalNote), ("failure", FailureNote)):
        text = notes.get(name, '{"actor":"r1","step":3,"cause":"none","expected":true}').encode()
        yield Parser(f"note {name}", (text,), _noted(path, name, kind))


def _files(out: Path, scratch: Path) -> Iterator[Parser]:
    robot = out / "r1"
    image = (robot / "map.png").read_bytes()
    (scratch / "world").mkdir()
    credentials.write_router_file(
        scratch / "router.json", credentials.issue({"r1": robot}, scratch / "world")
    )
    readers: tuple[tuple[str, Iterable[Path], Callable[[Path], object]], ...] = (
        ("scenario", (SHIPPED / "scenarios").glob("*.toml"), load_scenario),
        ("fleet", (SHIPPED / "fleets").glob("*.toml"), load_fleet),
        (
            "robot model",
            (REPOSITORY / "actors" / "models").glob("*.toml"),
            lambda path: load_model(str(path)),
        ),
        ("map", (robot / "map.yaml",), load_map),
        ("router file", (scratch / "router.json",), credentials.read_router_file),
        ("credentials", (robot / "credentials",), credentials.read),
    )
    (scratch / "map.png").write_bytes(image)
    for name, paths, reader in readers:
        seeds = tuple(path.read_bytes() for path in paths)
        yield Parser(name, seeds, _through_a_file(scratch / "file.toml", reader))
    (scratch / "map.yaml").write_bytes((robot / "map.yaml").read_bytes())
    through = _through_a_file(scratch / "map.png", lambda path: load_map(path.with_suffix(".yaml")))
    yield Parser("image of a map", (image,), through)


def _setups(planned: RunPlan, scratch: Path) -> Iterator[Parser]:
    robot = planned.world.robots[0]
    readers: tuple[tuple[str, Program, Callable[[Path], object]], ...] = (
        ("set-up of a world", plan.world_program(planned), world.load_setup),
        ("set-up of a radio", plan.radio_program(planned), radio.load_setup),
        ("set-up of a robot", plan.robot_program(planned, robot, ProcessOrder(robot.id, 0), 0), load_setup),
        ("laboratory's result", plan.world_program(planned), read_ground_truth),
    )
    for name, program, reader in readers:
        assert program.setup is not None
        yield Parser(name, (typed_json.dump(program.setup),), _through_a_file(scratch / "setup.json", reader))


def _decoder(topic: object) -> Callable[[bytes], object]:
    return lambda data: decode(topic, "swarm/key", data)  # type: ignore[arg-type]


def _noted(path: Path, name: str, kind: type[T]) -> Callable[[bytes], T]:
    return lambda data: decode_note(path, name, data.decode("utf-8", "replace"), kind)


def _through_a_file(path: Path, reader: Callable[[Path], object]) -> Callable[[bytes], object]:
    def parse(data: bytes) -> object:
        path.write_bytes(data)
        return reader(path)

    return parse


Made = tuple[str, tuple[bytes, ...], Callable[[bytes], object]]
"""Name, valid bytes and function of a parser."""


def device_parsers() -> Iterator[Made]:
    """Yield the parsers of radio board, base and lidar; noise on a wire is not an error there."""
    said = board_wire.encode_answer(SyncAnswer()) + b"".join(
        board_wire.encode_answer(ReceivedPacket(1, 2, 30, 200, 7, bytes(range(n))))
        + board_wire.encode_answer(PacketConfirmation(n, True))
        for n in range(10)
    )
    yield "board's answers", (said,), _answers
    yield (
        "board's sentence",
        (b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n",),
        lambda text: parse_rmc(START, text),
    )
    payload = encode_feedback(InertialSensorData(5, -7)) + encode_feedback(UnknownPacket(19, bytes(12)))
    yield "base's frames", (encode_frame(payload) * 4,), FrameReader(decode_feedback).take
    yield "base's packets", (payload,), _noisy(decode_feedback)
    yield "base's commands", (encode_command(BaseControl(100, 0)),), _noisy(decode_commands)
    turn = b"".join(Sample(angle == 0, 20, angle * 64, 4000).encode() for angle in range(360))
    yield "lidar's samples", (turn,), SampleReader().take


def _noisy(decode: Callable[[bytes], object]) -> Callable[[bytes], object]:
    def parse(data: bytes) -> None:
        with suppress(NoiseError, MalformedError):
            decode(data)

    return parse


def _answers(data: bytes) -> None:
    reader = AnswerReader()
    reader.feed(data)
    while reader.next(True, (1, 2, 3)) is not None:
        pass
