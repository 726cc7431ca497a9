"""Findings of the doctor about a simulated computer and about this one."""

import re
import subprocess
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest

from actors.robot.behaviour.foreign import INSTALLED, Permit
from deploy.fleet import doctor
from deploy.fleet.doctor import Certified, DoctorFinding, GroupMembership, Kernels, Machine
from deploy.fleet.fleet_file import Fleet, FleetRobot, load_fleet
from deploy.fleet.units import UsbPort
from firmware_bridge.device_lines import PseudoTerminal
from firmware_bridge.serial_port import KOBUKI
from tests.fleet.patient import Patient
from tests.fleet.texts import BOARD_AT_1, LIDAR_AT_2, OFFICE, ROOT, fleet, robot

CONSTRAINTS = (ROOT / "constraints.txt").read_text()
PINS = """\
# Some words.

# [base]
numpy==2.2.6; python_version < "3.14"
numpy==2.5.5; python_version >= "3.14"
rich==15.0.0

# [sim]
pymunk==7.3.1

# [hardware]
cryptography==50.0.2
pyserial==3.5
"""
HEALTHY = Patient(versions={"numpy": "2.2.6", "rich": "15.0.0", "cryptography": "50.0.2", "pyserial": "3.5"})
OFFICE_FLEET = load_fleet(OFFICE)
R2 = OFFICE_FLEET.robot_named("r2")


def well(subject: str, text: str) -> DoctorFinding:
    return DoctorFinding(subject, True, text)


def wrong(subject: str, text: str) -> DoctorFinding:
    return DoctorFinding(subject, False, text)


def behaviour(of: Fleet, one: FleetRobot, permit: Permit = INSTALLED) -> DoctorFinding:
    return doctor.finding("behaviour", doctor.behaviour, of, one, permit)


def test_packages_are_compared_with_the_tested_versions_of_this_python() -> None:
    assert list(doctor.packages(HEALTHY, PINS, ("base", "hardware"))) == [
        well("packages base", "2 packages, as they were tested"),
        well("packages sim", "not all installed, and not needed here"),
        well("packages hardware", "2 packages, as they were tested"),
    ]
    bare = HEALTHY.but(versions={"numpy": "2.2.5", "rich": "15.0.0", "pyserial": "3.5"})
    assert list(doctor.packages(bare, PINS, ("base", "hardware")))[::2] == [
        wrong(
            "packages base",
            "numpy is 2.2.5, but was tested as 2.2.6; remove .venv, and the next ./acrc makes it anew",
        ),
        wrong("packages hardware", "cryptography missing; `./acrc fleet units` installs what is"),
    ]
    newer = HEALTHY.but(python=(3, 14), versions={"numpy": "2.5.5", "rich": "15.0.0"})
    assert next(iter(doctor.packages(newer, PINS, ()))).ok
    assert not next(iter(doctor.packages(newer.but(python=(3, 13)), PINS, ()))).ok
    sections = {one.subject: one.text for one in doctor.packages(Machine(), CONSTRAINTS, ())}
    assert sections["packages hardware"] == "4 packages, as they were tested"


CACHE = Path("/clone/actors/__pycache__/kernels-1")
NEVER_SET = {"time": datetime(1970, 1, 1, tzinfo=UTC)}


@pytest.mark.parametrize(
    ("subject", "changes", "ok", "text"),
    [
        ("clock", {}, True, "2030-05-01 12:00 UTC, synchronised, off by at most 12 ms"),
        ("clock", NEVER_SET, False, "it shows the year 1970; set it with `sudo date --set="),
        ("clock", {"error": None}, False, "nothing keeps it right; connect the computer to a network"),
        ("disk", {}, True, "20.0 GB are free at /home/robot"),
        ("disk", {"free": 1_940_000_000}, False, "1.9 GB are free at /home/robot, but 2.0 should be"),
        ("kernels", {}, True, "all compiled, loaded in 0.4 s"),
        (
            "kernels",
            {"kernel_state": Kernels(CACHE, False, 40.0, 20)},
            False,
            f"as robot may not write to {CACHE}; `sudo chown -R robot {CACHE.parent}` allows it",
        ),
        ("kernels", {"kernel_state": Kernels(CACHE, True, 40.2, 20)}, True, "20 compiled just now"),
        ("namespaces", {"isolation": "no; allow it"}, False, "no; allow it"),
        ("group", {}, True, "robot may open the ports of the group dialout"),
        ("group", {"group": GroupMembership(False, False, False)}, False, "`sudo groupadd dialout`, "),
        ("group", {"group": GroupMembership(True, False, False)}, False, "`sudo usermod -aG dialout"),
        ("group", {"group": GroupMembership(True, True, False)}, False, "only from the next login"),
    ],
)
def test_what_a_computer_lacks_is_told_with_its_remedy(
    subject: str, changes: dict[str, object], ok: bool, text: str
) -> None:
    found = doctor.finding(subject, doctor.COMPUTER[subject], HEALTHY.but(**changes))
    assert found.ok is ok and text in found.text


AT_1 = fleet(robot(1, 'base = "/dev/ttyUSB1"')).robot_named("r1")
ITS_OWN = UsbPort("/dev/ttyUSB1", "0403", "6001", "kobuki_X")


@pytest.mark.parametrize(
    ("changes", "of", "ok", "text"),
    [
        ({}, R2, True, "/dev/kobuki opens, at /dev/ttyUSB0"),
        ({"names": {}, "plugged": (BOARD_AT_1, LIDAR_AT_2)}, R2, False, "no Kobuki is seen; plug it in and"),
        ({"names": {}}, R2, False, "/dev/ttyUSB0 looks like the Kobuki; install the udev rules that `acrc"),
        (
            {"names": {"/dev/kobuki": LIDAR_AT_2}},
            R2,
            False,
            "10c4:ea60 is plugged in there, which is no",
        ),
        ({"held": {"/dev/kobuki": ["minicom (PID 812)"]}}, R2, False, "minicom (PID 812) has the port open"),
        ({"port_faults": {"/dev/kobuki": "as the port says"}}, R2, False, "as the port says"),
        ({"names": {}}, AT_1, False, "/dev/ttyUSB0 looks like the Kobuki; give that as its port"),
        ({"names": {"/dev/ttyUSB1": ITS_OWN}}, AT_1, True, "/dev/ttyUSB1 opens"),
        # an emulated port may be held open by its emulator
        ({"names": {"/dev/kobuki": None}, "held": {"/dev/kobuki": ["python3 (PID 3)"]}}, R2, True, "opens"),
    ],
)
def test_whether_the_base_can_be_reached(
    changes: dict[str, object], of: FleetRobot, ok: bool, text: str
) -> None:
    found = next(doctor.devices(HEALTHY.but(**changes), of))
    assert (found.subject, found.ok) == ("base", ok) and text in found.text


def test_a_camera_must_be_usable_and_see_as_far_round_as_the_model_says() -> None:
    narrow = fleet(robot(1, 'range = "openni"\nsensor = "chapter"')).robot_named("r1")
    assert list(doctor.devices(HEALTHY, narrow))[-1] == wrong(
        "range",
        "the camera sees 58°, but the robot model's sensor has rays over 360°; it should be a sensor that "
        "sees no more than the camera",
    )
    camera = list(doctor.devices(HEALTHY.but(camera="install it"), narrow))[-1]
    assert camera == wrong("range", "install it")
    assert [found.subject for found in doctor.devices(HEALTHY, R2)] == ["base", "radio", "range"]


def test_map_start_places_and_behaviour_of_every_shipped_robot_are_well() -> None:
    for one in OFFICE_FLEET.robots:
        found = [*doctor.floor(OFFICE_FLEET, one), behaviour(OFFICE_FLEET, one)]
        assert [(finding.subject, finding.ok) for finding in found] == [
            ("map", True),
            ("start", True),
            ("places", True),
            ("behaviour", True),
        ]


def test_a_map_that_cannot_be_read_and_a_start_or_place_that_is_not_free_are_wrong() -> None:
    lost = fleet(head='map = "maps/nowhere.yaml"\n')
    assert list(doctor.floor(lost, lost.robot_named("r1"))) == [
        wrong("map", f"{ROOT}/maps/nowhere.yaml: the map cannot be read: No such file or directory.")
    ]
    one = fleet(robot(1, "start = [0, 0, 0]\nplaces = [[12.2, 5.9], [0, 0]]") + robot(2))
    _, start, places = doctor.floor(one, one.robot_named("r1"))
    assert not start.ok
    assert start.text.startswith("robot 'r1' at (0.00, 0.00) is not on free floor, but must be at least ")
    assert places == wrong("places", "place 1 at (0, 0) is not free, but must be on free floor")
    two = fleet(robot(1) + robot(2, "start = [12.1, 5.0, 0.0]"))
    assert list(doctor.floor(two, two.robot_named("r2")))[1] == wrong(
        "start", "r2 would stand 0.10 m from r1, but must be at least 0.35 m off"
    )


def test_a_strategy_that_cannot_be_made_is_told_why(tmp_path: Path) -> None:
    unknown = fleet('[run]\nstrategy = "chaptr"' + robot(1))
    assert behaviour(unknown, unknown.robot_named("r1")).text.startswith(
        "strategy 'chaptr' is not known; it should be one of "
    )
    (tmp_path / "broken_strategy.py").write_text("def made(start):\n    raise KeyError('reach')\n")
    own = fleet(f'[run]\nstrategy = "broken_strategy:made"\nmodules = "{tmp_path}"' + robot(1))
    assert behaviour(own, own.robot_named("r1"), Permit((tmp_path,))) == wrong(
        "behaviour", "strategy 'broken_strategy:made' fails with KeyError: 'reach'; mend its code"
    )


def test_keys_must_hold_today_for_this_robot_and_nobody_elses_eyes(tmp_path: Path) -> None:
    listening = fleet(robot(1, 'listen = "tls/0.0.0.0:7447"'), head=f'keys = "{tmp_path}"\nmap = "m.yaml"\n')
    folder = tmp_path / "r1"
    good = Certified("r1", datetime(2030, 1, 1, tzinfo=UTC), datetime(2031, 1, 1, tzinfo=UTC))

    def found(**changes: object) -> DoctorFinding:
        machine = HEALTHY.but(**{"certified": good} | changes)
        return doctor.finding("keys", doctor.keys, machine, listening, listening.robot_named("r1"))

    assert found().text.startswith(f"{folder}/authority.pem cannot be read (No such file or directory); ")
    folder.mkdir()
    for name in ("authority.pem", "certificate.pem", "key.pem"):
        (folder / name).touch()
    assert found() == well("keys", f"{folder}/certificate.pem holds until 2031-01-01")
    late = found(time=datetime(2032, 1, 1, tzinfo=UTC))
    assert not late.ok and "but it is 2032-01-01 here; set the clock, or make new keys" in late.text
    assert (
        found(key_mode=0o644).text == f"{folder}/key.pem can be read by others; `chmod 600 {folder}/key.pem`"
    )
    assert "certificate.pem is that of r2" in found(certified=Certified("r2", good.begins, good.ends)).text
    silent = fleet()
    *_, last = doctor.configuration(HEALTHY, silent, silent.robot_named("r1"), INSTALLED)
    assert last.subject == "behaviour"


def test_this_computer_answers_everything_that_it_is_asked(tmp_path: Path) -> None:
    machine: Machine = Machine()
    assert machine.exists(str(tmp_path)) and not machine.exists(str(tmp_path / "nothing"))
    assert machine.usb_port("/dev/null") is None
    assert all(port.vendor for port in machine.usb_ports())
    assert machine.port_fault(str(tmp_path / "no"), KOBUKI) == (
        f"{tmp_path}/no: there is no such port; plug in the Kobuki and switch it on, or give its right port"
    )
    assert not machine.membership("no-such-group").exists
    assert machine.now().tzinfo is UTC
    error = machine.clock_error()
    assert error is None or error >= 0
    assert machine.free_bytes() > 0
    assert machine.version_of("msgspec") is not None and machine.version_of("no-such-package") is None
    (tmp_path / "file").touch(mode=0o640)
    assert machine.mode(tmp_path / "file") == 0o640
    with pytest.raises(ValueError):
        machine.certificate(tmp_path / "file")
    assert machine.kernels().can_be_kept


def test_a_port_that_this_computer_has_is_opened_and_whoever_has_it_is_found(tmp_path: Path) -> None:
    machine = Machine()
    link = tmp_path / "kobuki"
    with PseudoTerminal(link) as terminal:
        assert machine.port_fault(str(link), KOBUKI) is None
        assert machine.holders(str(link)) == []
        script = f"exec 3<>{terminal.port}; echo has it; read line"
        with subprocess.Popen(
            ["/bin/sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "has it\n"
            assert machine.holders(str(link)) == [f"sh (PID {holder.pid})"]
            holder.communicate("")


def test_findings_are_printed_and_the_answer_is_whether_all_are_well(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pins = re.findall(r"^([\w.-]+)==([^;\s]+)", CONSTRAINTS, re.MULTILINE)
    newest = {("llvmlite", "0.50.0"), ("numba", "0.68.1"), ("numpy", "2.5.5")}
    well_off = HEALTHY.but(versions=dict(pin for pin in pins if pin not in newest))
    assert doctor.consult(None, None, json=False, machine=well_off)
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"ok     packages base        \d+ packages, as they were tested", lines[0])
    assert re.fullmatch(r"all \d+ are well", lines[-1])
    assert not doctor.consult(OFFICE, "r2", json=False, machine=well_off.but(free=0))
    out = capsys.readouterr().out
    assert "\nwrong  disk                 0.0 GB are free at /home/robot, but 2.0 should be" in out
    assert re.search(r"\n2 of \d+ are wrong\n$", out), "the disk, and keys that were never made"
    assert not doctor.consult(OFFICE, "r2", json=True, machine=well_off)
    report = msgspec.json.decode(capsys.readouterr().out, type=doctor.Report)
    assert (report.robot, report.ok) == ("r2", False)
    assert [finding.subject for finding in report.findings if not finding.ok] == ["keys"]
