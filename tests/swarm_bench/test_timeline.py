"""The timeline of a swarm: a well-formed file, in which nothing contradicts itself, of the same run."""

import json
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from actors.installation.usage import OptionError
from benchmarks.swarm.task import SwarmTask, planned
from benchmarks.swarm.timeline import command, trace_file
from deploy.run import swarm
from tests.swarm.command import acrc

ROBOTS, SECONDS, STEPS = 3, 4.0, 10
KINDS = ("world", "radio", "r1", "r2", "r3")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], dict[str, Any]]:
    path = tmp_path_factory.mktemp("timeline") / "t.json"
    figures = command.draw((ROBOTS,), SECONDS, path, steps=STEPS).figures
    content: dict[str, Any] = json.loads(path.read_text())
    return figures, content


def spans(content: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    names = {
        event["pid"]: event["args"]["name"]
        for event in content["traceEvents"]
        if event["ph"] == "M" and event["name"] == "process_name"
    }
    found = defaultdict(list)
    for event in content["traceEvents"]:
        if event["ph"] == "X":
            found[names[event["pid"]]].append(event)
    return found


def test_every_event_is_as_the_format_has_it(made: tuple[dict[str, Any], dict[str, Any]]) -> None:
    _, content = made
    needed = {
        "M": {"name", "pid", "args"},
        "X": {"name", "cat", "pid", "tid", "ts", "dur", "tts", "tdur", "args"},
        "s": {"name", "cat", "id", "pid", "tid", "ts"},
        "f": {"name", "cat", "id", "pid", "tid", "ts", "bp"},
        "i": {"name", "pid", "tid", "ts", "s", "args"},
    }
    for event in content["traceEvents"]:
        assert needed[event["ph"]] <= event.keys()
    assert tuple(spans(content)) == KINDS
    assert content["otherData"]["steps"] == [15, STEPS]


def test_a_process_does_one_thing_at_a_time_and_advances_once_a_step(
    made: tuple[dict[str, Any], dict[str, Any]],
) -> None:
    _, content = made
    for actor, events in spans(content).items():
        for before, after in pairwise(events):
            assert before["ts"] + before["dur"] == pytest.approx(after["ts"], abs=1e-2)
        assert all(event["dur"] >= 0 and event["tdur"] >= 0 for event in events)
        assert [event["args"]["step"] for event in events] == sorted(
            event["args"]["step"] for event in events
        )
        advances = [event["args"]["step"] for event in events if event["cat"] == "advance"]
        phases = 3 if actor == "world" else 1  # OPEN, CLOSE and MOVE
        assert advances == [step for step in range(15, 15 + STEPS) for _ in range(phases)]


def test_a_wait_ends_after_its_message_was_sent(made: tuple[dict[str, Any], dict[str, Any]]) -> None:
    _, content = made
    everything = [event for events in spans(content).values() for event in events]
    sent = {(e["args"]["key"], e["args"]["number"]): e for e in everything if e["cat"] == "send"}
    waits = [e for e in everything if e["cat"] == "wait"]
    known = [(sent[m], e) for e in waits if (m := (e["args"]["came"], e["args"]["number"])) in sent]
    assert len(known) >= len(waits) * 0.9  # what came first was sent in the step before the first
    for sending, waiting in known:
        assert waiting["ts"] + waiting["dur"] >= sending["ts"]
        if waiting["args"]["missing"] == waiting["args"]["came"]:
            assert waiting["name"].removeprefix("wait ") == sending["name"].removeprefix("send ")
    arrows: dict[str, dict[str, Any]] = defaultdict(dict)
    for event in content["traceEvents"]:
        if event["ph"] in "sf":
            arrows[event["id"]][event["ph"]] = event["ts"]
    assert sum("f" in arrow for arrow in arrows.values()) >= len(known) - len(KINDS)
    assert all(arrow["s"] <= arrow["f"] for arrow in arrows.values() if "f" in arrow)


def test_the_run_is_the_one_that_nobody_watches(made: tuple[dict[str, Any], dict[str, Any]]) -> None:
    figures, content = made
    with planned(ROBOTS, SwarmTask(seconds=SECONDS), "memory") as plan:
        plain = swarm.run_in_memory(plan, lambda progress: None)
    assert figures["digest"] == plain.digest == content["otherData"]["digest"]


def test_the_table_is_what_the_file_shows(made: tuple[dict[str, Any], dict[str, Any]]) -> None:
    figures, _ = made
    assert [(kind["kind"], kind["processes"]) for kind in figures["kinds"]] == [
        ("world", 1),
        ("radio", 1),
        ("robots", ROBOTS),
    ]
    world = figures["kinds"][0]
    assert world["works_ms"] + world["waits_ms"] == pytest.approx(figures["step_ms"], rel=0.5)
    assert 0 < figures["idle_ms"] <= figures["cores"] * figures["step_ms"] * 1.5
    assert figures["slowest"]["robot"] in KINDS and 1 <= figures["slowest"]["steps"] <= STEPS


def test_what_cannot_be_drawn_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(OptionError) as folder:
        trace_file.check(tmp_path)
    assert str(folder.value) == f"--timeline: {tmp_path} is a folder; must be a file"
    with pytest.raises(OptionError) as nowhere:
        trace_file.check(tmp_path / "none" / "t.json")
    assert str(nowhere.value) == f"--timeline: {tmp_path / 'none'} is no folder; must be one that exists"
    words = ("bench", "swarm", "--timeline", tmp_path / "t.json", "--robots", "4", "--robots", "20")
    done = acrc(*words)
    assert done.returncode == 2
    assert done.stderr.strip() == "acrc: --robots: '4 20'; must be one number with --timeline"
