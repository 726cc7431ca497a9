"""`acrc record info|echo|plot`: what was said on a key, from recordings, also while a run goes on."""

import csv
import json
import re
from pathlib import Path

import pytest

from actors.messages import CONTROL, Control
from actors.orders import Kill
from actors.runtime.codec import encode
from actors.runtime.recording import Recorder
from observation.recordings import lines
from observation.recordings.topics import TopicError, fits, follow, has_ended, messages
from tests.swarm.command import acrc


def test_info_of_keys_names_fields_and_rates_in_simulated_time(met: Path) -> None:
    said = acrc("record", "info", met, "*").stdout.splitlines()
    assert len(said) == 3 * 13
    at = said.index(next(line for line in said if line.startswith("r1/senses  Senses: step, instant,")))
    assert said[at + 1] == (
        "  201 messages from 0 to 20 s: 10.00 Hz, 0.1 to 0.1 s apart, standard deviation 0.000 s"
    )
    assert re.fullmatch(r"  \d+ B, \d+ B each on average, \d+ to \d+ B, \d+ B/s", said[at + 2])
    words = ("record", "info", met, "r1/drive", "truth", "--from", 1, "--to", 2, "--json")
    drive, truth = json.loads(acrc(*words).stdout)
    assert (drive["key"], drive["type"], drive["messages"]) == ("r1/drive", "Drive", 11)
    assert (truth["key"], truth["first_s"], truth["last_s"]) == ("truth", 1.0, 2.0)
    done = acrc("record", "info", met, "--follow")
    assert (done.returncode, done.stderr) == (
        2, "acrc: --follow, --from, --to: must stand beside a KEY, such as '*'\n",
    )  # fmt: skip


def test_keys_fit_in_short_in_full_and_with_a_star() -> None:
    assert fits("swarm/up/r1/drive", "r1/drive") and fits("swarm/up/r1/drive", "swarm/up/r1/drive")
    assert fits("swarm/up/r1/drive", "*/drive") and fits("swarm/infra/truth", "truth")
    assert not fits("swarm/up/r1/drive", "drive") and not fits("swarm/up/r11/drive", "r1/drive")


def test_echo_shows_every_message_with_its_time(met: Path) -> None:
    said = acrc("record", "echo", met, "r1/drive").stdout.splitlines()
    assert len(said) == 200 and said[150].startswith("    15.000 s  r1/drive  step=150 vx=")
    rows = list(csv.DictReader(acrc("record", "echo", met, "*/drive", "--csv").stdout.splitlines()))
    assert len(rows) == 400 and {row["key"] for row in rows} == {"r1/drive", "r2/drive"}
    assert [float(row["seconds"]) for row in rows[:4]] == [0.0, 0.0, 0.1, 0.1]
    assert float(rows[0]["pose[0]"]) == 12.44 and rows[2]["route"] == ""
    told = acrc("record", "echo", met, "r1/drive", "--from", 15, "--to", 15.1, "--json").stdout
    first, second = map(json.loads, told.splitlines())
    assert (first["seconds"], first["key"], first["type"]) == (15.0, "r1/drive", "Drive")
    assert second["message"]["step"] == 151 and len(second["message"]["pose"]) == 3


def test_a_number_is_drawn_and_what_is_none_is_told(met: Path, tmp_path: Path) -> None:
    done = acrc("record", "plot", met, "*/drive", "vx", "--out", tmp_path / "vx.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "vx.png").read_bytes().startswith(b"\x89PNG")
    for key, field, sentence in (
        ("*/drive", "speed", "'speed': no field of r1/drive; there are step, vx"),
        ("r1/drive", "route", "'route': is [{"),
        ("r9/drive", "vx", f"{met}: nothing was recorded on 'r9/drive'"),
    ):
        done = acrc("record", "plot", met, key, field, "--out", tmp_path / "x.png")
        assert done.returncode == 1 and done.stderr.startswith(f"acrc: {sentence}"), done.stderr


def test_a_table_has_messages_of_one_type(met: Path) -> None:
    with pytest.raises(TopicError, match="must be keys of one type"):
        list(lines.table(messages(met, "r1/*")))


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
