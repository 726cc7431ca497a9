"""Files and bytes that were made to hurt: one sentence each, in bounded time and memory."""

import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from actors import toml_file
from actors.floor.map_file import load_map
from actors.floor.map_header import MapError
from actors.messages import MESSAGE_VERSION, TOPICS
from actors.processes.last_word import last_line
from actors.robot_model import load_model
from actors.runtime.access import credentials, router_file
from actors.runtime.codec import WireError, decode
from actors.runtime.errors import AcrcError, printable
from actors.topic import Message, Topic
from deploy.fleet.collect import collect
from deploy.fleet.fleet_file import load_fleet
from deploy.scenario.scenario_file import load_scenario
from deploy.scenario.stack_tables import stack

SECONDS = 3.0
"""On a busy machine; what is quadratic takes minutes."""
TOMLS = {
    "dotted keys": "a." * 100_000 + "a = 1",
    "dotted and quoted keys": '"a" . ' * 60_000 + "a = 1",
    "a dotted table": "[" + "a." * 100_000 + "a]",
    "lists in lists": "a = " + "[" * 100_000,
    "tables in tables": "a = " + "{a = " * 100_000,
    "a hexadecimal number": "a = 0x" + "f" * 5000,
    "a number beyond any float": "[deeco]\npublish = " + "1" * 400,
    "a decimal number": "a = " + "1" * 5000,
    "a binary number": "a = 0b" + "1" * 900_000,
    "an open text": 'a = """' + "\\" * 900_000,
    "many lines of it": 'a = "' + '""" ' * 200_000,
    "keys that nobody knows": "".join(f"k{number} = 1\n" for number in range(30_000)),
    "the same in a table": "[deeco]\n" + "".join(f"k{number} = 1\n" for number in range(30_000)),
    "settings that are none": "[strategy]\n" + "".join(f"k{number} = [[]]\n" for number in range(30_000)),
    "places that are none": "[[robot]]\nplaces = [" + "3, " * 100_000 + "]",
}
READERS: dict[str, Callable[[Path], object]] = {
    "scenario": load_scenario,
    "fleet": load_fleet,
    "model": lambda path: load_model(str(path)),
}


@pytest.mark.parametrize("name", TOMLS)
def test_toml_that_was_made_to_hurt(tmp_path: Path, name: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(TOMLS[name])
    for reader in READERS.values():
        began = time.process_time()
        with pytest.raises(AcrcError) as caught:
            reader(path)
        assert time.process_time() - began < SECONDS
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


def test_a_key_of_too_many_parts_is_named() -> None:
    with pytest.raises(ValueError) as caught:
        toml_file.loads('a = """\na.b\n""" # ' + "a." * 50 + "\n\n" + "b." * 32 + "b = 1")
    assert str(caught.value) == "line 5 has a key of more than 32 parts"
    assert toml_file.loads('a.b = "' + "c." * 100 + '" # ' + "d." * 100) == {"a": {"b": "c." * 100}}
    assert toml_file.loads("a = [" + "1.5, " * 100 + "]")["a"] == [1.5] * 100


@pytest.mark.parametrize("key", ["map = ", "[run]\nmodules = ", "[robots]\nmodel = "])
def test_a_path_with_a_zero_character(tmp_path: Path, key: str) -> None:
    path = tmp_path / "file.toml"
    rest = "" if key.startswith("map") else 'map = "floor.yaml"\n'
    path.write_text(f'{rest}{key}"a\\u0000b"\n')
    with pytest.raises(AcrcError) as caught:
        load_scenario(path)
    assert r'"a\u0000b", but must be the ' in str(caught.value)


def test_links_that_lead_to_themselves(tmp_path: Path) -> None:
    loop = tmp_path / "loop.toml"
    loop.symlink_to(loop)
    for reader in (load_scenario, load_fleet):
        with pytest.raises(AcrcError, match="Too many levels of symbolic links"):
            reader(loop)
    (tmp_path / "scenario.toml").write_text('map = "loop.toml"\n')
    with pytest.raises(MapError, match="Too many levels of symbolic links"):
        load_map(load_scenario(tmp_path / "scenario.toml").map)
    robot = tmp_path / "runs" / "r1"
    robot.mkdir(parents=True)
    (robot / "r1.mcap").symlink_to(robot / "r1.mcap")
    with pytest.raises(AcrcError, match=r"r1\.mcap: a link, and a recording never is"):
        collect([tmp_path / "runs"])


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.kind.__name__)
def test_messages_that_were_made_to_hurt(topic: Topic[Message]) -> None:
    version = bytes([MESSAGE_VERSION])
    number = len(topic.kind.__struct_fields__)
    rest = msgspec.msgpack.encode(0) * (number - 2)
    for hurt in (
        b"\x91" * 100_000,
        b"\xdd\x7f\xff\xff\xff",
        b"\xdf\x7f\xff\xff\xff",
        b"\xc6\x7f\xff\xff\xff",
        b"\x81\x91\x01\x01",
        b"\xda\xff\xff" + b"\x1b" * 65535,
    ):
        for payload in (
            hurt,
            bytes([0x90 + number, 5]) + hurt + rest,
            bytes([0x90 + number, 5]) + rest + hurt,
        ):
            tracemalloc.start()
            with pytest.raises(WireError) as caught:
                decode(topic, "swarm/k", version + payload)
            assert tracemalloc.get_traced_memory()[1] < 20_000_000
            tracemalloc.stop()
            assert "\x1b" not in str(caught.value) and len(str(caught.value)) < 400


def test_a_map_whose_yaml_refers_to_itself(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    bombs = "".join(f"  - &b{n} [{', '.join([f'*b{n - 1}'] * 9)}]\n" for n in range(1, 12))
    head = "resolution: 0.05\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    for key in ("image", "origin"):
        other = "origin" if key == "image" else "image"
        path.write_text(f"{head}{other}: [0, 0, 0]\n{key}:\n  - &b0 [1]\n{bombs}")
        with pytest.raises(MapError) as caught:
            load_map(path)
        assert len(str(caught.value)) < 500


def test_a_folder_in_the_place_of_the_routers_socket(tmp_path: Path) -> None:
    robot, world = tmp_path / "r1", tmp_path / "world"
    for folder in (robot, world):
        folder.mkdir()
    issued = credentials.issue({"r1": robot}, world)
    router_file.write(world / "router.json", issued)
    (robot / "router.sock").mkdir()
    with pytest.raises(AcrcError) as caught:
        router_file.remove(world / "router.json")
    assert str(caught.value).startswith(
        f"what the run has put there could not be removed: {robot.resolve()}/router.sock ("
    )
    assert list(world.iterdir()) == [] and [path.name for path in robot.iterdir()] == ["router.sock"]


def test_what_a_terminal_would_obey_is_shown_instead() -> None:
    assert str(AcrcError("r1 \x1b[2J\x9b31m\x07 says \u202eabc\ud800\r")) == (
        r"r1 \x1b[2J\x9b31m\x07 says \u202eabc\ud800\r"
    )
    assert printable("ä → \t b\n") == "ä → \t b\n"


def test_the_last_line_of_an_endless_log(tmp_path: Path) -> None:
    path = tmp_path / "r1.log"
    path.write_bytes(b"first\n" + bytes(50_000_000) + b"\n the \x1b[2Jlast \xff\n\n")
    tracemalloc.start()
    assert last_line(path) == "the \\x1b[2Jlast \ufffd"
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()
    assert last_line(tmp_path / "none.log") == ""


def test_a_key_without_end_is_cut_in_its_sentence() -> None:
    with pytest.raises(AcrcError) as caught:
        stack({"localisation": {"a" * 5000: 1}})
    assert str(caught.value).startswith(f"localisation.{'a' * 60}… is not known; ")
    assert len(str(caught.value)) < 1000
