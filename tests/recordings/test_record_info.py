"""`acrc record info` and `check` of single recordings, and the values that other commands print."""

import json
import re
from pathlib import Path

import pytest
from mcap.reader import make_reader

from actors.runtime.recording import RecordingError
from observation.recordings.info import info
from observation.recordings.plain import at_column, plain
from observation.recordings.topics import messages
from observation.replay.record_check import check_recording
from tests.swarm.command import acrc


def test_check_of_one_recording_reports_its_length_and_refuses_damage(met: Path, tmp_path: Path) -> None:
    told, words = check_recording(met / "r1" / "r1.mcap")
    assert told["whole"] and told["good_until"] == 200 and words.endswith(", whole, good up to step 200")
    damaged = tmp_path / "r1.mcap"
    content = bytearray((met / "r1" / "r1.mcap").read_bytes())
    content[len(content) // 2] ^= 1
    damaged.write_bytes(content)
    with pytest.raises(RecordingError, match="damaged"):
        check_recording(damaged)


def test_info_counts_what_is_there_and_says_what_was_cut(met: Path, tmp_path: Path) -> None:
    found = {one.actor: one for one in info(met)}
    assert list(found) == ["r1", "r2", "radio", "world"]
    robot = found["r1"]
    assert robot.whole and (robot.first, robot.last) == (0.0, 20.0) and robot.seals > 200
    assert robot.size == (met / "r1" / "r1.mcap").stat().st_size
    senses = robot.topics["in", "swarm/down/r1/senses"]
    assert senses.count == 201 and senses.hertz == pytest.approx(10.0)
    done = acrc("record", "info", met)
    assert re.search(
        r"^4 recordings, all whole: 20 s, \d+ B, \d\.\d\d MB per simulated minute$", done.stdout, re.M
    )
    told = json.loads(acrc("record", "info", met, "--json").stdout)
    assert [one["actor"] for one in told] == list(found) and told[0]["messages"] == robot.messages
    cut = tmp_path / "r1.mcap"
    cut.write_bytes((met / "r1" / "r1.mcap").read_bytes()[:-5000])
    done = acrc("record", "info", cut)
    assert ", cut, or not closed yet; " in done.stdout and re.search(
        r"^  in  r1/senses +\d+ messages", done.stdout, re.M
    )


def test_a_scan_is_shown_in_millimetres_and_columns_lead_to_what_plain_shows(met: Path) -> None:
    one = next(iter(messages(met / "r1" / "r1.mcap", "r1/senses"))).message()
    assert one is not None
    ranges = plain(one)["scan"]["ranges_mm"]
    assert len(ranges) > 100 and at_column(one, "scan.ranges_mm") == ranges
    assert at_column(one, "scan.ranges_mm[3]") == ranges[3]


def test_a_process_recording_names_the_fields_of_its_messages(met: Path) -> None:
    """They are arrays there; any reader shows the names in the channel's schema."""
    with (met / "world" / "world.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    (drive,) = {one.schema_id for one in summary.channels.values() if one.topic.endswith("/drive")}
    schema = summary.schemas[drive]
    assert (schema.name, schema.encoding) == ("Drive", "acrc-fields")
    fields = json.loads(schema.data)
    assert list(fields) == ["Drive", "PlaceReport", "PlaceGivenUp", "PlaceKey"]
    assert fields["Drive"][:4] == ["step", "vx", "vy", "omega"] and fields["PlaceKey"] == ["owner", "place"]
    assert len(summary.schemas) < 10, "one for each type"
