"""`acrc export --mcap`: the same bytes each time, chosen robots, real robots' recordings, wrong input."""

from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.field_trial.rewriting import clock
from tests.field_trial.runs import copies
from tests.robot_logs.conftest import parsed, write
from tests.swarm.command import acrc


@pytest.mark.parametrize("form", ["ros2", "foxglove"])
def test_the_same_run_gives_the_same_bytes(form: str, out: Path, request: pytest.FixtureRequest) -> None:
    first: Path = request.getfixturevalue(f"{form}_file")
    done = acrc("export", out, "--mcap", form)
    assert done.returncode == 0, done.stderr
    path = out.with_name(f"run.{form}.mcap")
    topics = 26 if form == "ros2" else 24
    assert done.stdout.startswith(f"{path}: ") and f" messages of {topics} topics, " in done.stdout
    assert path.read_bytes() == first.read_bytes()
    again = acrc("export", out, "--mcap", form)
    assert again.returncode == 2 and again.stderr.splitlines()[-1].endswith("must be a new file")


def test_of_other_robots_it_is_where_they_were(out: Path, tmp_path: Path) -> None:
    report = write(out, "foxglove", tmp_path / "one.mcap", "r2")
    of_others = {topic for topic in report.counts if topic.startswith("/r1/")}
    assert of_others == {"/r1/truth", "/r1/pose"} and report.counts["/r2/scan"] > 50


def test_of_real_robots_no_truth_is_told(out: Path, tmp_path: Path) -> None:
    trial = copies(out, tmp_path / "trial", {"r1": clock(5_000_000), "r2": clock(0)})
    report = write(trial, "foxglove", tmp_path / "trial.mcap")
    bare, *faults, early = report.notes
    assert bare == "no map lies beside the recordings: the floor is drawn bare"
    assert faults == [
        f"{trial / robot / 'map.yaml'}: the map cannot be read: No such file or directory."
        for robot in ("r1", "r2")
    ]
    assert early == (  # the copies have the scans' stamps as they were, and r1's clock went 5 s ahead of them
        "/r1/scan: 50 messages are left out, which no sensor or clock of a run can have given"
    )
    with (tmp_path / "trial.mcap").open("rb") as stream:
        log = parsed(make_reader(stream))
    assert "/things" not in log and not any(topic.endswith("/truth") for topic in log)
    frames = {one.child_frame_id for _, message in log["/tf"] for one in message.transforms}
    assert frames == {f"{robot}/{name}" for robot in ("r1", "r2") for name in ("odom", "base_link")}
    bodies = log["/robots"][0][1].entities
    assert {one.frame_id for one in bodies} == {"r1/base_link", "r2/base_link"}
    assert max(logged for logged, _ in log["/r1/scan"]) < 11e9 and "/r1/plan" not in log


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (("{out}", "--mcap", "ros1"), 2, "--mcap: ros1; must be one of ros2, foxglove"),
        (
            ("{out}", "--mcap", "ros2", "--robot", "r9", "--out", "{new}"),
            2,
            "--robot: r9; must be one of r1, r2",
        ),
        (("{out}", "--robot", "r1"), 2, "--robot: requires --mcap; tables are of all robots"),
        (("{empty}", "--mcap", "ros2"), 1, "{empty}: no run's folder: there is no */*.mcap in it"),
        (
            ("{out}", "--mcap", "ros2", "--out", "{file}"),
            2,
            "--out: {file} is there already; must be a new file",
        ),
    ],
)
def test_wrong_input_gets_a_sentence(
    words: tuple[str, ...], code: int, sentence: str, out: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "f").touch()
    given = {"out": out, "empty": tmp_path / "empty", "file": tmp_path / "f", "new": tmp_path / "n"}
    done = acrc("export", *(word.format_map(given) for word in words))
    assert done.returncode == code
    assert sentence.format_map(given) in done.stderr.replace("\n", "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "f"]
