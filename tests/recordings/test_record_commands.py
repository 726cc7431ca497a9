"""`acrc record info|check|echo|plot`: messages and rates by key, also while a run goes on."""

import csv
import json
import re
from pathlib import Path

import pytest
from mcap.reader import make_reader

from acrc_testbed.recordings import message_formats
from acrc_testbed.recordings.message_formats import column_value, recording_statistics, to_json_types
from acrc_testbed.recordings.record_check import check_recording
from acrc_testbed.recordings.topics import TopicError, follow, has_ended, matches, messages
from actors.messages import CONTROL, Control
from actors.orders import Kill
from actors.runtime.codec import encode
from actors.runtime.recording import Recorder, RecordingError
from tests.in_process import acrc


def test_check_of_one_recording(recorded_run: Path, tmp_path: Path) -> None:
    told, words = check_recording(recorded_run / "r1" / "r1.mcap")
    assert told["whole"] and told["good_until"] == 300 and words.endswith(", complete, valid up to step 300")
    damaged = tmp_path / "r1.mcap"
    content = bytearray((recorded_run / "r1" / "r1.mcap").read_bytes())
    content[len(content) // 2] ^= 1
    damaged.write_bytes(content)
    with pytest.raises(RecordingError, match="damaged"):
        check_recording(damaged)


def test_info_counts_messages_and_reports_truncation(recorded_run: Path, tmp_path: Path) -> None:
    found = {one["actor"]: one for one in recording_statistics(recorded_run)}
    assert list(found) == ["r1", "r2", "radio", "world"]
    robot = found["r1"]
    assert robot["whole"] and (robot["first_s"], robot["last_s"]) == (0.0, 30.0) and robot["seals"] > 300
    assert robot["bytes"] == (recorded_run / "r1" / "r1.mcap").stat().st_size
    senses = next(one for one in robot["keys"] if one["key"] == "r1/senses")
    assert (senses["direction"], senses["messages"]) == ("in", 301)
    assert senses["hertz"] == pytest.approx(10.0)
    done = acrc("record", "info", recorded_run)
    assert re.search(
        r"^4 recordings, all complete: 30 s, \d+ B, \d\.\d\d MB per simulated minute$", done.stdout, re.M
    )
    cut = tmp_path / "r1.mcap"
    cut.write_bytes((recorded_run / "r1" / "r1.mcap").read_bytes()[:-5000])
    done = acrc("record", "info", cut)
    assert ", truncated or still open; " in done.stdout and re.search(
        r"^  in  r1/senses +\d+ messages", done.stdout, re.M
    )


def test_a_process_recording_names_the_fields_of_its_messages(recorded_run: Path) -> None:
    """They are arrays there; any reader shows the names in the channel's schema."""
    with (recorded_run / "world" / "world.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    (drive,) = {one.schema_id for one in summary.channels.values() if one.topic.endswith("/drive")}
    schema = summary.schemas[drive]
    assert (schema.name, schema.encoding) == ("Drive", "acrc-fields")
    fields = json.loads(schema.data)
    assert list(fields) == ["Drive", "ItemGivenUp", "ItemKey"]
    assert fields["Drive"][:4] == ["step", "vx", "vy", "omega"] and fields["ItemKey"] == ["owner", "number"]
    assert len(summary.schemas) < 10, "one for each type"


def test_info_of_keys_names_fields_and_rates_in_simulated_time(recorded_run: Path) -> None:
    said = acrc("record", "info", recorded_run, "*").stdout.splitlines()
    assert len(said) == 3 * len({line.split()[0] for line in said[::3]}) >= 3 * 13
    at = said.index(next(line for line in said if line.startswith("r1/senses  SensorData: step, instant,")))
    assert said[at + 1] == (
        "  messages: 301, from 0 to 30 s: 10.00 Hz, 0.1 to 0.1 s apart, standard deviation 0.000 s"
    )
    assert re.fullmatch(r"  \d+ B, \d+ B each on average, \d+ to \d+ B, \d+ B/s", said[at + 2])
    words = ("record", "info", recorded_run, "r1/drive", "truth", "--from", 1, "--to", 2, "--json")
    drive, truth = json.loads(acrc(*words).stdout)
    assert (drive["key"], drive["type"], drive["messages"]) == ("r1/drive", "Drive", 11)
    assert (truth["key"], truth["first_s"], truth["last_s"]) == ("truth", 1.0, 2.0)


def test_short_full_and_wildcard_keys() -> None:
    assert matches("swarm/up/r1/drive", "r1/drive") and matches("swarm/up/r1/drive", "swarm/up/r1/drive")
    assert matches("swarm/up/r1/drive", "*/drive") and matches("swarm/infra/truth", "truth")
    assert not matches("swarm/up/r1/drive", "drive") and not matches("swarm/up/r11/drive", "r1/drive")


def test_echo_shows_every_message_with_its_time(recorded_run: Path) -> None:
    said = acrc("record", "echo", recorded_run, "r1/drive").stdout.splitlines()
    assert len(said) == 300 and said[150].startswith("    15.000 s  r1/drive  step=150 vx=")
    rows = list(csv.DictReader(acrc("record", "echo", recorded_run, "*/drive", "--csv").stdout.splitlines()))
    assert len(rows) == 600 and {row["key"] for row in rows} == {"r1/drive", "r2/drive"}
    assert [float(row["seconds"]) for row in rows[:4]] == [0.0, 0.0, 0.1, 0.1]
    assert float(rows[0]["pose[0]"]) == pytest.approx(12.44, abs=0.01) and rows[2]["route"] == ""
    told = acrc("record", "echo", recorded_run, "r1/drive", "--from", 15, "--to", 15.1, "--json").stdout
    first, second = map(json.loads, told.splitlines())
    assert (first["seconds"], first["key"], first["type"]) == (15.0, "r1/drive", "Drive")
    assert second["message"]["step"] == 151 and len(second["message"]["pose"]) == 3
    one = next(iter(messages(recorded_run / "r1" / "r1.mcap", "r1/senses"))).message()
    assert (
        one is not None
        and column_value(one, "scan.ranges_mm[3]") == to_json_types(one)["scan"]["ranges_mm"][3]
    )
    with pytest.raises(TopicError, match="give keys of one type"):
        list(message_formats.csv_lines(messages(recorded_run, "r1/*")))


def test_plot_draws_numbers_and_rejects_other_values(recorded_run: Path, tmp_path: Path) -> None:
    done = acrc("record", "plot", recorded_run, "*/drive", "vx", "--out", tmp_path / "vx.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "vx.png").read_bytes().startswith(b"\x89PNG")
    for key, field, sentence in (
        ("*/drive", "speed", "'speed': not a field of r1/drive; choose from step, vx"),
        ("r1/drive", "route", "'route': [{"),
        ("r9/drive", "vx", f"{recorded_run}: no messages on 'r9/drive'"),
    ):
        done = acrc("record", "plot", recorded_run, key, field, "--out", tmp_path / "x.png")
        assert done.returncode == 1 and done.stderr.startswith(f"acrc: {sentence}"), done.stderr


def test_a_growing_recording_is_followed_to_its_end(tmp_path: Path) -> None:
    """What is not sealed yet is not there yet; an order stands where it was taken."""
    (tmp_path / "world").mkdir()
    order = encode(Control(0, (Kill("r1"),)), CONTROL.pattern)
    with Recorder(tmp_path / "world" / "world.mcap", 100_000) as recorder:
        recorder.received(CONTROL.pattern, 0, 0, order)
        recorder.flush()
        recorder.received(CONTROL.pattern, 0, 1, order)
        asked: list[int] = []

        def ended() -> bool:
            asked.append(1)
            if len(asked) == 2:
                recorder.flush()
            return len(asked) == 3

        followed = follow(tmp_path, ["control"], ended)
        assert next(followed).sequence == 0 and not has_ended(tmp_path)
        assert [one.sequence for one in followed] == [1]
    assert has_ended(tmp_path)
    assert [one.key for one in messages(tmp_path, "*")] == 2 * [CONTROL.pattern]


def test_radio_events_are_found_at_their_own_time(complete_run: Path) -> None:
    words = ("record", "echo", complete_run, "r2/received")
    found = acrc(*words, "--from", 14.70, "--to", 14.705)
    assert '"instant": 147022' in found.stdout and "    14.800 s" in found.stdout
    empty = acrc(*words, "--from", 5000)
    assert (empty.returncode, empty.stdout) == (0, "")
    assert empty.stderr == f"{complete_run}: nothing on r2/received in this interval\n"
