"""What recordings hold, and all of it in one file for any reader: `acrc record info` and `merge`."""

import json
import re
import shutil
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader

from actors.messages import TOPICS
from actors.runtime.recording import RecordingError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
from observation.recordings.info import info
from observation.recordings.merged_file import PHASES, check_merged, merge
from observation.recordings.plain import at_column, plain
from observation.recordings.topics import messages
from observation.replay.record_check import check
from tests.swarm.command import acrc


@pytest.fixture(scope="module")
def merged(met: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("merged") / "run.mcap"
    merge(met, file)
    return file


def test_the_mcap_package_alone_shows_fields_by_name(met: Path, merged: Path) -> None:
    counts: Counter[str] = Counter()
    with merged.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert schema is not None and (schema.encoding, channel.message_encoding) == (
                "jsonschema",
                "json",
            )
            properties = json.loads(schema.data)["properties"]
            assert json.loads(message.data).keys() <= properties.keys()
            counts[channel.topic] += 1
            if channel.topic == "swarm/up/r1/drive" and message.log_time == 2_000_000_000:
                drive = json.loads(message.data)
    assert drive["step"] == 20 and isinstance(drive["vx"], float) and len(drive["pose"]) == 3
    assert counts["swarm/down/r2/senses"] == 201 and counts["swarm/infra/truth"] == 201
    for key, count in counts.items():
        assert count == len(list(messages(met, key)))


def test_the_same_run_gives_the_same_bytes(met: Path, merged: Path, tmp_path: Path) -> None:
    plan = swarm.plan(load_scenario(met / "scenario.toml"), RunOptions(tmp_path / "again", bus="memory"))
    swarm.run_in_memory(plan, lambda progress: None)
    merge(tmp_path / "again", tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == merged.read_bytes()


def test_a_robot_whose_recording_is_lost_is_in_it_as_the_others_took_it(
    met: Path, merged: Path, tmp_path: Path
) -> None:
    part = shutil.copytree(met, tmp_path / "part")
    (part / "r2" / "r2.mcap").unlink()
    about = merge(part, tmp_path / "part.mcap").about
    assert about.recordings == ("r1", "radio", "world")
    assert about.messages == check_merged(merged).messages
    assert about.hashes > 150, "its scans are too large to be kept by who sends them"
    assert check_merged(tmp_path / "part.mcap") == about


def test_every_topic_has_its_phase_and_its_schema_fits_its_messages() -> None:
    recorded = {topic.pattern for topic in TOPICS} - {"swarm/infra/progress", "swarm/infra/answered"}
    assert {topic.pattern for topic in PHASES} == recorded


def test_check_says_what_a_file_is_and_finds_damage(met: Path, merged: Path, tmp_path: Path) -> None:
    done = acrc("record", "check", merged)
    assert done.stdout == (
        f"a merged file of r1, r2, radio, world: {check_merged(merged).messages} messages, in canonical "
        f"order, of the run with the digest {check(met).digest}\n"
    )
    done = acrc("record", "check", met / "r1" / "r1.mcap")
    assert re.fullmatch(
        r"the recording of r1: \d+ digested messages, whole, good up to step 200\n", done.stdout
    )
    data = merged.read_bytes()
    damaged = tmp_path / "damaged.mcap"
    for content in (data[: len(data) // 2], data[:-20], data.replace(b'"step":150,', b'"step":151,', 1)):
        damaged.write_bytes(content)
        with pytest.raises(RecordingError, match="damaged, or not a merged file"):
            check_merged(damaged)


def test_a_file_that_is_there_is_left_alone(met: Path, merged: Path) -> None:
    done = acrc("record", "merge", met, "--out", merged)
    assert (done.returncode, done.stderr) == (1, f"acrc: {merged}: is there already; should be a new file\n")
    done = acrc("record", "info", merged, "*")
    assert done.returncode == 1 and "a merged file, for other programs" in done.stderr


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
