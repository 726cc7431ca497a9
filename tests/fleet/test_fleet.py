"""The fleet file, and the commands fleet keys, units and doctor."""

import json
import re
import stat
from pathlib import Path

import pytest

from actors.runtime.access.tls import load_keys
from actors.runtime.errors import AcrcError
from deploy.fleet.fleet_file import load_fleet
from tests.cli.test_cli import acrc
from tests.fleet.texts import HEAD, OFFICE, ROBOT, ROOT, fault, fleet, robot

POWER = "0, -0.5 or -6.3 dBm, or one of them less 10, 20 or 30, which is what the firmware can set"
LISTEN = '"tls/HOST:PORT", such as "tls/0.0.0.0:7447"'


def test_the_shipped_fleet_is_three_turtlebots_on_the_corridor() -> None:
    office = load_fleet(OFFICE)
    assert [(robot.id, robot.address, robot.model) for robot in office.robots] == [
        ("r1", 1, "turtlebot2"),
        ("r2", 2, "turtlebot2"),
        ("r3", 3, "turtlebot2"),
    ]
    assert office.path == OFFICE
    assert office.map == ROOT / "maps" / "corridor.yaml"
    assert office.keys_of("r2") == ROOT / "fleets" / "office-keys" / "r2"
    assert office.robot("r2").start == (17.5, 5.0, 0.0)
    assert office.run.strategy == "chapter"


def test_what_is_absent_is_as_the_original_robots_had_it() -> None:
    one = fleet()
    assert (one.radio.pan, one.radio.channel, one.radio.power_db) == (0xBABA, 11, 0.0)
    assert (one.step_ms, one.seed, one.run.strategy) == (100, 1, "none")
    assert one.run.modules == str(ROOT)
    (robot,) = one.robots
    assert (robot.model, robot.sensor, robot.range, robot.listen) == ("turtlebot2", None, None, None)
    assert robot.listen_host is None and not robot.listens_everywhere


def test_paths_are_relative_to_the_file_wherever_one_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "fleets").mkdir()
    file = tmp_path / "fleets" / "mine.toml"
    file.write_text(
        'map = "../maps/floor.yaml"\nkeys = "secret"\n[run]\nmodules = "own"\n'
        + robot(1, 'model = "models/wide.toml"')
    )
    monkeypatch.chdir(tmp_path)
    mine = load_fleet(Path("fleets/mine.toml"))
    assert mine.path == file
    assert mine.map == tmp_path / "maps" / "floor.yaml"
    assert mine.keys == tmp_path / "fleets" / "secret"
    assert mine.run.modules == str(tmp_path / "fleets" / "own")
    assert mine.robot("r1").model == str(tmp_path / "fleets" / "models" / "wide.toml")


def test_robots_read_strategy_exchange_and_areas_as_in_a_simulation() -> None:
    told = fleet(
        '[strategy]\nreach = 0.5\n[deeco]\nrelay = true\n[[area]]\nname = "A"\nx = [0, 1]\ny = [2, 3]\n'
        + ROBOT
    ).adaptation
    assert told.settings == {"reach": 0.5}
    assert told.exchange.relay
    assert [area.name for area in told.areas] == ["A"]


@pytest.mark.parametrize(
    ("listen", "host", "everywhere"),
    [
        ("tls/0.0.0.0:7447", "0.0.0.0", True),
        ("tls/[::]:7447", "::", True),
        ("tls/192.168.1.12:1", "192.168.1.12", False),
        ("tls/[fe80::1]:65535", "fe80::1", False),
        ("tls/r2.local:7447", "r2.local", False),
    ],
)
def test_a_robot_knows_where_it_listens(listen: str, host: str, everywhere: bool) -> None:
    one = fleet(robot(1, f'listen = "{listen}"')).robot("r1")
    assert (one.listen_host, one.listens_everywhere) == (host, everywhere)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "robot is missing, but must be written as tables [[robot]]"),
        ("step_ms = 15" + ROBOT, "step_ms is 15, but must be a multiple of 10 ms, from 10 to 100"),
        ("[run]\nstrateg = 1" + ROBOT, "run.strateg is not known; did you mean run.strategy?"),
        ("[radio]\npan = 0xFFFF" + ROBOT, "radio.pan is 65535, but must be a whole number from 0 to 0xFFFE"),
        ("[radio]\npower_db = 1" + ROBOT, f"radio.power_db is 1, but must be {POWER}"),
        (robot(1, 'id = "R1"'), 'robot[0].id is "R1", but must be the id of a robot, such as "r2"'),
        (robot(1, "start = [1, 2]"), "robot[0].start is [1, 2], but must be a pose [x, y, heading]"),
        (ROBOT.replace("places = [[12.2, 5.9]]", ""), "robot[0].places is missing, but must be a list of"),
        (robot(1, 'base = "kobuki"'), 'robot[0].base is "kobuki", but must be the path of a port, such as'),
        (robot(1, 'range = "kinect"'), 'robot[0].range is "kinect", but must be the path of a lidar\'s port'),
        (robot(1, 'listen = "tcp/0.0.0.0:7447"'), f'"tcp/0.0.0.0:7447", but must be {LISTEN}'),
        (robot(1, 'listen = "tls/a b:7447"'), f'robot[0].listen is "tls/a b:7447", but must be {LISTEN}'),
        (robot(1) + robot(1, "address = 2"), 'robot[1].id is "r1" once more, but each robot must have an id'),
        (robot(1) + robot(2, "address = 1"), "robot[1].address is 1 as that of r1, but each robot must"),
        (robot(1, 'range = "/dev/kobuki"'), 'robot[0].range is "/dev/kobuki" as robot[0].base, but each'),
        ("[deeco]\nhop_limit = 16" + ROBOT, "deeco.hop_limit is 16, but must be a whole number from 1 to 15"),
    ],
)
def test_a_fault_is_one_sentence(text: str, sentence: str) -> None:
    assert sentence in fault(text)
    assert fault(robot(1) + robot(2)) == "nothing was wrong", "each robot has a computer of its own"


def test_a_file_that_is_not_there_or_no_toml_is_named(tmp_path: Path) -> None:
    file = tmp_path / "f.toml"
    with pytest.raises(AcrcError, match=f"{file}: the fleet file cannot be read: No such file or directory"):
        load_fleet(file)
    file.write_text(HEAD + "= 3")
    with pytest.raises(AcrcError, match=rf"{file}: this is no TOML: Invalid statement \(at line 2, column 1"):
        load_fleet(file)
    assert fault(ROBOT, head="").startswith("map is missing, but must be the path of a map's YAML file")


UNNAMED = (
    "acrc: {0} listens at all its addresses, but its certificate holds for names only; to reach it by an "
    "address, give that: --host {0}=192.168.1.12\n"
)


@pytest.fixture
def office(tmp_path: Path) -> Path:
    """The shipped fleet file, where keys may be made beside it."""
    text = OFFICE.read_text().replace("../maps", str(ROOT / "maps"))
    file = tmp_path / "office.toml"
    file.write_text(text)
    return file


def test_keys_are_made_beside_the_fleet_file_and_each_has_a_goal(office: Path) -> None:
    code, out, err = acrc("fleet", "keys", str(office), "--host", "r1=10.0.0.1", "--host", "r2=10.0.0.2")
    assert code == 0
    assert err == UNNAMED.format("r3")
    keys = office.parent / "office-keys"
    lines = out.splitlines()
    assert lines[:4] == [
        f"{keys}/authority",
        "  stays with you, and off the robots: whoever has it can make keys of this fleet, "
        "for its key is not encrypted",
        f"{keys}/r1",
        f"  to r1:{keys}/r1; holds for r1, r1.local, 10.0.0.1",
    ]
    assert lines[8:10] == [
        f"{keys}/operator",
        "  to the laptop of whoever watches and stops the robots",
    ]
    assert lines[10].startswith("All hold until 20")
    for machine in ("r1", "r2", "r3", "operator"):
        assert stat.S_IMODE(load_keys(keys / machine).private_key.stat().st_mode) == 0o600


def test_revoking_replaces_all_keys_and_says_what_is_to_be_done(office: Path) -> None:
    assert acrc("fleet", "keys", str(office), "--host", "r1=10.0.0.1", "--host", "r3=10.0.0.3")[0] == 0
    code, out, err = acrc("fleet", "keys", str(office), "--revoke", "r2", "--revoke", "operator")
    assert (code, err) == (0, UNNAMED.format("r2"))
    keys = office.parent / "office-keys"
    (aside,) = office.parent.glob("office-keys.until-*")
    assert out.splitlines()[3] == f"  to r1:{keys}/r1; holds for r1, r1.local, 10.0.0.1"
    assert out.splitlines()[-2:] == [
        "What r2, operator had is worth nothing to a machine that has its new folder: copy them all, the "
        "operator's first, and start the robots again.",
        f"The old keys are in {aside}; delete them after that.",
    ]


def test_units_are_written_and_installed_by_nobody_but_you(office: Path, tmp_path: Path) -> None:
    out = tmp_path / "units"
    code, said, err = acrc("fleet", "units", str(office), "--robot", "r2", "--out", str(out), "--user", "me")
    assert code == 0
    assert all("plugged in, so nothing gets this name" in line for line in err.splitlines())
    assert sorted(path.name for path in out.iterdir()) == ["60-acrc.rules", "acrc-r2.service"]
    service = (out / "acrc-r2.service").read_text()
    assert f"\nExecStart={ROOT}/acrc fleet onboard {office} --robot r2\n" in service
    assert "\nUser=me\n" in service
    assert f"  sudo install -m 644 {out}/60-acrc.rules /etc/udev/rules.d/\n" in said
    assert "  sudo systemctl enable --now acrc-r2.service\n" in said


def test_the_doctor_finds_what_is_wrong_and_says_so_by_its_exit_code(office: Path) -> None:
    code, out, err = acrc("fleet", "doctor", str(office), "--robot", "r2")
    assert (code, err) == (1, "")
    assert re.search(r"(?m)^wrong  base +/dev/kobuki: there is no such port, and no Kobuki is seen; ", out)
    code, out, _ = acrc("fleet", "doctor", str(office), "--robot", "r2", "--json")
    report = json.loads(out)
    assert (code, report["robot"], report["ok"]) == (1, "r2", False)
    assert {"subject", "ok", "text"} == set(report["findings"][0])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("keys", "{}", "--days", "0"), "--days: 0; must be a whole number from 1 to 3650"),
        (("keys", "{}", "--revoke", "r9"), '{}: there is no robot "r9" in the fleet; it has r1, r2, r3'),
        (("units", "{}", "--robot", "r9"), '{}: there is no robot "r9" in the fleet; it has r1, r2, r3'),
        (
            ("doctor", "{}"),
            "--robot: is missing; must say which of the robots this computer is: r1, r2, r3",
        ),
        (
            ("doctor", "--robot", "r2"),
            "--robot: r2 without a fleet file; must be as in acrc fleet doctor fleet.toml --robot r2",
        ),
    ],
)
def test_a_wrong_command_line_is_one_sentence(words: tuple[str, ...], sentence: str, office: Path) -> None:
    code, out, err = acrc("fleet", *(word.format(office) for word in words))
    assert (code, out, err) == (2, "", f"acrc: {sentence.format(office)}\n")
