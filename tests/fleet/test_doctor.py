"""Findings of the doctor about a simulated computer and about this one."""

import re
import subprocess
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import pytest

from actors.robot.behaviour.code_permit import INSTALLED, Permit
from deploy.fleet import doctor
from deploy.fleet.doctor import DoctorFinding
from deploy.fleet.fleet_file import Fleet, FleetRobot, load_fleet
from deploy.fleet.units import UsbPort, usb_port, usb_ports
from firmware_bridge.device_lines import PseudoTerminal
from tests.fleet.fleet_texts import BOARD_AT_1, LIDAR_AT_2, OFFICE, ROOT, fleet, robot
from tests.fleet.simulated_computer import CACHE, SimulatedComputer

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
TESTED = {"numpy": "2.2.6", "rich": "15.0.0", "cryptography": "50.0.2", "pyserial": "3.5"}
OFFICE_FLEET = load_fleet(OFFICE)
R2 = OFFICE_FLEET.robot_named("r2")


def passed(subject: str, text: str) -> DoctorFinding:
    return DoctorFinding(subject, True, text)


def failed(subject: str, text: str) -> DoctorFinding:
    return DoctorFinding(subject, False, text)


def behaviour(of: Fleet, one: FleetRobot, permit: Permit = INSTALLED) -> DoctorFinding:
    return doctor.run_check("behaviour", doctor.check_behaviour, of, one, permit)


def packages(patch: pytest.MonkeyPatch, versions: dict[str, str], minor: int = 11) -> list[DoctorFinding]:
    SimulatedComputer(versions=versions).install(patch)
    return list(doctor.check_packages(PINS, ("base", "hardware"), minor))


def test_packages_are_compared_with_the_tested_versions_of_this_python(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    real = {one.subject: one.text for one in doctor.check_packages(CONSTRAINTS, ())}
    assert real["packages hardware"] == "4 packages, tested versions"
    assert packages(monkeypatch, TESTED) == [
        passed("packages base", "2 packages, tested versions"),
        passed("packages sim", "not all installed; not needed here"),
        passed("packages hardware", "2 packages, tested versions"),
    ]
    assert packages(monkeypatch, {"numpy": "2.2.5", "rich": "15.0.0", "pyserial": "3.5"})[::2] == [
        failed(
            "packages base",
            "numpy 2.2.5 is installed, tested is 2.2.6; remove .venv and run ./acrc, which recreates it",
        ),
        failed("packages hardware", "cryptography missing; run `./acrc fleet units` to install"),
    ]
    for minor in (13, 14):
        assert packages(monkeypatch, {"numpy": "2.5.5", "rich": "15.0.0"}, minor)[0].ok is (minor == 14)


NEVER_SET = {"time": datetime(1970, 1, 1, tzinfo=UTC)}


@pytest.mark.parametrize(
    ("subject", "changes", "ok", "text"),
    [
        ("clock", {}, True, "2030-05-01 12:00 UTC, synchronised, error at most 12 ms"),
        ("clock", NEVER_SET, False, "the year is 1970; set the clock with `sudo date --set="),
        ("clock", {"error": None}, False, "not synchronised; connect the computer to a network"),
        ("disk", {}, True, "20.0 GB free at "),
        ("disk", {"free": 1_940_000_000}, False, ", 2.0 GB needed; remove old recordings"),
        ("kernels", {}, True, "all compiled, loaded in 0.4 s"),
        (
            "kernels",
            {"keeps_kernels": False},
            False,
            f"robot has no write access to {CACHE}; run `sudo chown -R robot {CACHE.parent}`",
        ),
        ("kernels", {"compiled": (40.2, 20)}, True, "20 compiled in 40 s and cached"),
        ("namespaces", {"isolation": "no; allow it"}, False, "no; allow it"),
        ("group", {}, True, "robot may open ports of the group dialout"),
        ("group", {"has_group": False}, False, "`sudo groupadd dialout`, "),
        ("group", {"listed": False, "groups": ()}, False, "`sudo usermod -aG dialout"),
        ("group", {"groups": ()}, False, "after the next login"),
    ],
)
def test_checks_of_the_computer_report_faults_with_a_remedy(
    subject: str, changes: dict[str, Any], ok: bool, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    SimulatedComputer(**changes).install(monkeypatch)
    found = doctor.run_check(subject, doctor.COMPUTER_CHECKS[subject])
    assert found.ok is ok and text in found.text


AT_1 = fleet(robot(1, 'base = "/dev/ttyUSB1"')).robot_named("r1")
ITS_OWN = UsbPort("/dev/ttyUSB1", "0403", "6001", "kobuki_X")


@pytest.mark.parametrize(
    ("changes", "of", "ok", "text"),
    [
        ({}, R2, True, "/dev/kobuki opens (/dev/ttyUSB0)"),
        ({"names": {}, "plugged": (BOARD_AT_1, LIDAR_AT_2)}, R2, False, "no Kobuki found; plug it in and"),
        ({"names": {}}, R2, False, "/dev/ttyUSB0 looks like the Kobuki; install the udev rules written by"),
        (
            {"names": {"/dev/kobuki": LIDAR_AT_2}},
            R2,
            False,
            "USB device 10c4:ea60 is not a Kobuki",
        ),
        ({"held": {"/dev/kobuki": ["minicom (PID 812)"]}}, R2, False, "minicom (PID 812) has the port open"),
        ({"port_faults": {"/dev/kobuki": "as the port says"}}, R2, False, "as the port says"),
        ({"names": {}}, AT_1, False, "/dev/ttyUSB0 looks like the Kobuki; enter it in the fleet file"),
        ({"names": {"/dev/ttyUSB1": ITS_OWN}}, AT_1, True, "/dev/ttyUSB1 opens"),
        # an emulated port may be held open by its emulator
        ({"names": {"/dev/kobuki": None}, "held": {"/dev/kobuki": ["python3 (PID 3)"]}}, R2, True, "opens"),
    ],
)
def test_port_of_the_base_is_checked(
    changes: dict[str, Any], of: FleetRobot, ok: bool, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    SimulatedComputer(**changes).install(monkeypatch)
    found = next(doctor.check_devices(of))
    assert (found.subject, found.ok) == ("base", ok) and text in found.text


def test_a_camera_must_be_usable_and_cover_the_models_field_of_view(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    SimulatedComputer().install(monkeypatch)
    narrow = fleet(robot(1, 'range = "openni"\nsensor = "chapter"')).robot_named("r1")
    assert list(doctor.check_devices(narrow))[-1] == failed(
        "range",
        "the camera's field of view is 58°, that of the robot model's sensor is 360°; choose a sensor within "
        "the camera's field of view",
    )
    assert [found.subject for found in doctor.check_devices(R2)] == ["base", "radio", "range"]
    SimulatedComputer(camera="install it").install(monkeypatch)
    assert list(doctor.check_devices(narrow))[-1] == failed("range", "install it")


@pytest.mark.parametrize("shipped", [OFFICE_FLEET, load_fleet(ROOT / "fleets" / "turtlebot4.toml")])
def test_map_start_places_and_behaviour_of_every_shipped_robot_pass(shipped: Fleet) -> None:
    for one in shipped.robots:
        found = [*doctor.check_floor(shipped, one), behaviour(shipped, one)]
        subjects = ("map", "start", "places", "behaviour")
        assert [(finding.subject, finding.ok) for finding in found] == [(name, True) for name in subjects]


def test_an_unreadable_map_and_occupied_starts_and_places_are_reported() -> None:
    lost = fleet(head='map = "maps/nowhere.yaml"\n')
    assert list(doctor.check_floor(lost, lost.robot_named("r1"))) == [
        failed("map", f"{ROOT}/maps/nowhere.yaml: the map cannot be read: No such file or directory.")
    ]
    one = fleet(robot(1, "start = [0, 0, 0]\nplaces = [[12.2, 5.9], [0, 0]]") + robot(2))
    _, start, places = doctor.check_floor(one, one.robot_named("r1"))
    assert not start.ok
    assert start.text.startswith("robot 'r1' at (0.00, 0.00) is not on free floor, but must be at least ")
    assert places == failed("places", "place 1 is [0.0, 0.0], but must be on free floor")
    two = fleet(robot(1) + robot(2, "start = [12.1, 5.0, 0.0]"))
    assert list(doctor.check_floor(two, two.robot_named("r2")))[1] == failed(
        "start", "r2 starts 0.10 m from r1, must be at least 0.35 m"
    )


def test_failures_of_strategies_are_reported(tmp_path: Path) -> None:
    unknown = fleet('[run]\nstrategy = "chaptr"' + robot(1))
    assert behaviour(unknown, unknown.robot_named("r1")).text.startswith(
        "unknown strategy 'chaptr'; choose from "
    )
    (tmp_path / "broken_strategy.py").write_text("def made(start):\n    raise KeyError('reach')\n")
    own = fleet(f'[run]\nstrategy = "broken_strategy:made"\nmodules = "{tmp_path}"' + robot(1))
    assert behaviour(own, own.robot_named("r1"), Permit((tmp_path,))) == failed(
        "behaviour", "strategy 'broken_strategy:made' failed with KeyError: 'reach'; fix its code"
    )


def test_the_key_of_packets_must_be_valid_and_private(tmp_path: Path) -> None:
    own = fleet(
        "[radio]\nauthenticated = true" + robot(1),
        head=f'keys = "{tmp_path}"\nmap = "{ROOT}/maps/corridor.yaml"\n',
    )
    file = tmp_path / "r1" / "packets.key"

    def found() -> DoctorFinding:
        *_, last = doctor.check_configuration(own, own.robot_named("r1"), INSTALLED)
        return last

    assert found() == failed(
        "packet key",
        f"{file} cannot be read (No such file or directory); it is the key of the fleet's packets: copy it "
        "from a robot's folder of `acrc fleet keys`",
    )
    file.parent.mkdir()
    for content in (b"", b"secret", b"0" * 31, b"0" * 33, b"\xff" * 32, b"0" * 2000):
        file.write_bytes(content)
        file.chmod(0o600)
        assert found() == failed("packet key", f"{file} is damaged; must contain 32 hexadecimal digits")
    file.write_text("0123456789abcdef0123456789ABCDEF\n")
    assert found() == passed("packet key", f"{file} is private")
    file.chmod(0o640)
    assert found().text == f"{file} is readable by other users; run `chmod 600 {file}`"


def test_keys_must_be_valid_private_and_of_this_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listening = fleet(robot(1, 'listen = "tls/0.0.0.0:7447"'), head=f'keys = "{tmp_path}"\nmap = "m.yaml"\n')
    folder = tmp_path / "r1"
    begin, end = datetime(2030, 1, 1, tzinfo=UTC), datetime(2031, 1, 1, tzinfo=UTC)

    def found(name: str = "r1", **changes: Any) -> DoctorFinding:
        SimulatedComputer(certified=(name, begin, end), **changes).install(monkeypatch)
        return doctor.run_check("keys", doctor.check_keys, listening, listening.robot_named("r1"))

    assert found().text.startswith(f"{folder}/authority.pem cannot be read (No such file or directory); ")
    folder.mkdir()
    for name in ("authority.pem", "certificate.pem", "key.pem"):
        (folder / name).touch(mode=0o600)
    assert found() == passed("keys", f"{folder}/certificate.pem is valid until 2031-01-01")
    late = found(time=datetime(2032, 1, 1, tzinfo=UTC))
    assert not late.ok and "today is 2032-01-01; set the clock, or create keys" in late.text
    assert "certificate.pem belongs to r2" in found("r2").text
    (folder / "key.pem").chmod(0o644)
    assert found().text == f"{folder}/key.pem is readable by other users; run `chmod 600 {folder}/key.pem`"
    silent = fleet()
    *_, last = doctor.check_configuration(silent, silent.robot_named("r1"), INSTALLED)
    assert last.subject == "behaviour"


def test_all_checks_run_on_this_computer(tmp_path: Path) -> None:
    assert usb_port("/dev/null") is None
    assert all(port.vendor for port in usb_ports())
    assert doctor.now().tzinfo is UTC
    error = doctor.clock_error()
    assert error is None or error >= 0
    assert doctor.version_of("msgspec") is not None and doctor.version_of("no-such-package") is None
    (tmp_path / "file").touch()
    with pytest.raises(ValueError):
        doctor.read_certificate(tmp_path / "file")
    found = [doctor.run_check(subject, check) for subject, check in doctor.COMPUTER_CHECKS.items()]
    assert [one.subject for one in found] == ["clock", "disk", "namespaces", "kernels", "group"]
    assert found[3].ok, found[3].text


def test_ports_are_opened_and_processes_that_hold_them_are_found(tmp_path: Path) -> None:
    link = tmp_path / "kobuki"
    here = fleet(robot(1, f'base = "{link}"')).robot_named("r1")
    assert next(doctor.check_devices(here)).text.startswith(f"{link}: no such port")
    with closing(PseudoTerminal(link)) as terminal:
        assert next(doctor.check_devices(here)) == passed("base", f"{link} opens")
        assert doctor.processes_using(str(link)) == []
        script = f"exec 3<>{terminal.port}; echo open; read line"
        with subprocess.Popen(
            ["/bin/sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "open\n"
            assert doctor.processes_using(str(link)) == [f"sh (PID {holder.pid})"]
            holder.communicate("")


def test_findings_are_printed_and_failures_returned(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    pins = re.findall(r"^([\w.-]+)==([^;\s]+)", CONSTRAINTS, re.MULTILINE)
    newest = {("llvmlite", "0.50.0"), ("numba", "0.68.1"), ("numpy", "2.5.5")}
    versions = dict(pin for pin in pins if pin not in newest)
    SimulatedComputer(versions=versions).install(monkeypatch)
    monkeypatch.setattr(doctor.check_packages, "__defaults__", (11,))
    assert doctor.check_computer(None, None, json=False)
    lines = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"ok     packages base        \d+ packages, tested versions", lines[0])
    assert re.fullmatch(r"all \d+ checks passed", lines[-1])
    SimulatedComputer(versions=versions, free=0).install(monkeypatch)
    assert not doctor.check_computer(OFFICE, "r2", json=False)
    out = capsys.readouterr().out
    assert "\nfailed disk                 0.0 GB free at " in out
    assert re.search(r"\n2 of \d+ checks failed\n$", out), "the disk, and missing keys"
    SimulatedComputer(versions=versions).install(monkeypatch)
    assert not doctor.check_computer(OFFICE, "r2", json=True)
    report = msgspec.json.decode(capsys.readouterr().out, type=doctor.DoctorReport)
    assert (report.robot, report.ok) == ("r2", False)
    assert [finding.subject for finding in report.findings if not finding.ok] == ["keys"]
