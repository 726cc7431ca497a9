"""Service and udev rules of a robot; systemd's own verifiers check them where they are installed."""

import fnmatch
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from actors.installation.usage import OptionError
from actors.runtime.errors import AcrcError
from deploy.fleet.fleet_file import load_fleet
from deploy.fleet.udev import UsbPort, rules, unnamed
from deploy.fleet.units import everyday_user, service, write
from tests.fleet.patient import BOARD_AT_1, KOBUKI_AT_0, LIDAR_AT_2
from tests.fleet.texts import OFFICE, ROOT, fleet, robot

ACRC = ROOT / "acrc"
ALL = (KOBUKI_AT_0, BOARD_AT_1, LIDAR_AT_2)


def seen(port: UsbPort) -> dict[str, str]:
    """A port as udev shows it to the rules."""
    found = {"SUBSYSTEM": "tty", "idVendor": port.vendor, "idProduct": port.product, "KERNELS": port.socket}
    return found | ({"serial": port.serial} if port.serial else {})


KOBUKI, FTDI, CP2102 = map(seen, ALL)
MINE = {"GROUP=": "dialout", "MODE=": "0660", "TAG+=": "systemd"}
RULE_TOKEN = r'([A-Z]+(?:\{[A-Za-z0-9_/.]+\})?(?:==|!=|\+=|=))"([^"\\]*)"'
FAST = {"ATTR{device/latency_timer}=": "1"}


Rule = dict[str, str]


def read_unit(text: str) -> dict[str, dict[str, list[str]]]:
    """Values by section and key."""
    sections: dict[str, dict[str, list[str]]] = {}
    for line in text.splitlines():
        if line.startswith("["):
            current = sections.setdefault(line.strip("[]"), {})
        elif line and not line.startswith("#"):
            key, _, value = line.partition("=")
            current.setdefault(key, []).append(value)
    return sections


def words(line: str) -> list[str]:
    """A command line as systemd splits and unescapes it."""
    return [re.sub(r"(%|\$)\1", r"\1", word) for word in shlex.split(line)]


def read_rules(text: str) -> list[Rule]:
    """The rules, each as a value by `KEY operator` or `KEY{attribute} operator`."""
    lines = (line for line in text.splitlines() if line and not line.startswith("#"))
    rules = [[re.fullmatch(RULE_TOKEN, token) for token in line.split(", ")] for line in lines]
    assert all(token is not None for rule in rules for token in rule), text
    return [{token[1]: token[2] for token in rule if token is not None} for rule in rules]


def effect(rules: list[Rule], device: Rule, action: str = "add") -> Rule:
    """What the rules make of a device with these attributes (`SUBSYSTEM`, `idVendor`, …), as udev would."""
    made: Rule = {}
    goal = ""
    for rule in rules:
        if goal and rule.get("LABEL=") != goal:
            continue
        if all(_holds(key, value, device | {"ACTION": action}) for key, value in rule.items()):
            goal = rule.get("GOTO=", "")
            set_here = {key: value for key, value in rule.items() if key[-2] not in "=!"}
            made |= {key: value for key, value in set_here.items() if key not in {"GOTO=", "LABEL="}}
    return made


def _holds(key: str, value: str, device: Rule) -> bool:
    if not key.endswith(("==", "!=")):
        return True
    actual = device.get(key[:-2].removeprefix("ATTRS{").rstrip("}"))
    return actual is not None and fnmatch.fnmatchcase(actual, value) is key.endswith("==")


def unit(more: str = "", path: Path = OFFICE, program: Path = ACRC) -> dict[str, dict[str, list[str]]]:
    loaded = fleet(robot(2, more), path=path)
    return read_unit(service(loaded, loaded.robot("r2"), program=program, user="robot"))


def test_the_service_is_the_robot_from_switching_on_and_is_not_restarted_for_ever() -> None:
    sections = unit()
    assert words(sections["Service"]["ExecStart"][0]) == [
        str(ACRC),
        "fleet",
        "onboard",
        str(OFFICE),
        "--robot",
        "r2",
    ]
    expected = {
        "User": "robot",
        "SupplementaryGroups": "dialout",
        "Restart": "on-failure",
        "SuccessExitStatus": "143",
        "StandardOutput": "journal",
        "SyslogIdentifier": "acrc-r2",
    }
    assert {key: sections["Service"][key] for key in expected} == {k: [v] for k, v in expected.items()}
    assert sections["Unit"]["StartLimitBurst"] == ["5"]
    assert sections["Unit"]["StartLimitIntervalSec"] == ["300"]
    assert sections["Install"]["WantedBy"] == ["multi-user.target"]


def test_a_supervisor_that_hangs_is_noticed_and_what_is_killed_with_it_has_a_last_word() -> None:
    service = unit()["Service"]
    assert (service["Type"], service["NotifyAccess"]) == (["notify"], ["main"])
    assert (service["TimeoutStartSec"], service["WatchdogSec"]) == (["900"], ["20"])
    python, *stop = words(service["ExecStopPost"][0])
    assert python == f"-{ROOT}/.venv/bin/python"
    guardian = ROOT / "firmware_bridge" / "kobuki" / "guardian.py"
    assert stop == ["-I", "-S", str(guardian), "alone", "/dev/kobuki"]
    assert guardian.is_file()


def test_it_waits_for_its_devices_and_for_an_address_of_its_own_but_else_for_no_network() -> None:
    sections = unit('base = "/dev/ttyUSB0"\nradio = "/dev/robot-1/bee click"\nrange = "openni"')
    assert sections["Unit"]["Wants"] == [r"dev-ttyUSB0.device dev-robot\x2d1-bee\x20click.device"]
    assert sections["Unit"]["After"] == [
        r"time-set.target dev-ttyUSB0.device dev-robot\x2d1-bee\x20click.device"
    ]
    own = unit('listen = "tls/192.168.1.12:7447"')
    assert own["Unit"]["Wants"] == ["dev-kobuki.device dev-beeclick.device network-online.target"]
    assert own["Unit"]["After"][0].startswith("time-set.target network-online.target dev-kobuki")
    everywhere = unit('listen = "tls/0.0.0.0:7447"')
    assert everywhere["Unit"]["After"] == ["time-set.target dev-kobuki.device dev-beeclick.device"]


def test_the_sandbox_leaves_devices_namespaces_and_compiled_kernels_alone() -> None:
    own = unit()["Service"]
    assert own["DevicePolicy"] == ["closed"]
    assert own["DeviceAllow"] == ["char-ttyUSB rw", "char-ttyACM rw"]
    assert own["ReadWritePaths"] == [str(ROOT)]
    assert (
        not {
            "RestrictNamespaces",
            "MemoryDenyWriteExecute",
            "PrivateDevices",
            "PrivateNetwork",
            "PrivateUsers",
            "SystemCallFilter",
        }
        & own.keys()
    )
    assert unit('range = "openni"')["Service"]["DeviceAllow"][2:] == ["char-usb_device rw"]


def test_paths_with_all_that_means_something_to_systemd_stay_what_they_are() -> None:
    folder = Path('/home/a b/50% "off" $HOME/back\\slash')
    own = unit(path=folder / "fleet.toml", program=folder / "acrc")["Service"]
    assert words(own["ExecStart"][0]) == [
        str(folder / "acrc"), "fleet", "onboard", str(folder / "fleet.toml"), "--robot", "r2"
    ]  # fmt: skip
    assert own["ReadWritePaths"] == [r'"/home/a b/50%% \"off\" $HOME/back\\slash"']


def test_a_user_must_be_one(tmp_path: Path) -> None:
    office = load_fleet(OFFICE)
    with pytest.raises(AcrcError, match="--user: 'me\nExecStart=/bin/sh'; must be the name of a user of"):
        write(office, office.robot("r1"), tmp_path, program=ACRC, user="me\nExecStart=/bin/sh", plugged=())
    (tmp_path / "file").write_text("")
    with pytest.raises(AcrcError, match=f"--out: {tmp_path}/file is a file; must be a folder"):
        write(office, office.robot("r1"), tmp_path / "file", program=ACRC, user="robot", plugged=())


@pytest.mark.parametrize(
    ("device", "expected"),
    [
        (KOBUKI, MINE | FAST | {"SYMLINK+=": "kobuki"}),
        (FTDI, MINE | FAST | {"SYMLINK+=": "beeclick"}),
        (FTDI | {"serial": "A50285BJ"}, MINE | FAST),
        (CP2102, MINE | {"SYMLINK+=": "rplidar"}),
        (CP2102 | {"KERNELS": "1-1.4"}, MINE),
        ({"SUBSYSTEM": "tty", "idVendor": "2341", "idProduct": "0043"}, {}),
        (KOBUKI | {"SUBSYSTEM": "usb"}, {}),
    ],
)
def test_every_device_gets_its_name_and_no_other(device: dict[str, str], expected: dict[str, str]) -> None:
    made = read_rules(rules(load_fleet(OFFICE).robot("r2"), ALL))
    assert effect(made, device) == expected
    assert effect(made, device, action="remove") == {}


@pytest.mark.parametrize(
    "port",
    ["/dev/ttyACM0", "/dev/pts/3", "/dev/serial/by-id/x", "/tmp/kobuki", "/dev/a b"],
)
def test_what_a_rule_cannot_or_must_not_name_it_does_not(port: str) -> None:
    text = rules(fleet(robot(1, f'base = "{port}"')).robot("r1"), ALL)
    assert [rule["SYMLINK+="] for rule in read_rules(text) if "SYMLINK+=" in rule] == ["beeclick"]
    camera = fleet(robot(1, 'range = "openni"')).robot("r1")
    assert effect(read_rules(rules(camera, ALL)), CP2102) == {}


R2 = load_fleet(OFFICE).robot("r2")
SECOND = UsbPort("/dev/ttyUSB3", "0403", "6001", "B1", "1-1.4")


@pytest.mark.parametrize(
    ("plugged", "name", "why"),
    [
        ((KOBUKI_AT_0, LIDAR_AT_2), "beeclick", "no BEE-click board is plugged in"),
        (
            (*ALL, SECOND),
            "beeclick",
            "/dev/ttyUSB1 (serial number A50285BI) and /dev/ttyUSB3 (serial number B1) could each be the",
        ),
        (
            (*ALL, LIDAR_AT_2._replace(path="/dev/ttyUSB4", socket="2-1")),
            "rplidar",
            "/dev/ttyUSB2 (USB port 1-1.3) and /dev/ttyUSB4 (USB port 2-1) could each be the RPLIDAR",
        ),
    ],
)
def test_a_chip_that_is_not_alone_or_not_there_gets_no_name(
    plugged: tuple[UsbPort, ...], name: str, why: str
) -> None:
    (said,) = unnamed(R2, plugged)
    assert said.startswith(f"/dev/{name}: {why}") and unnamed(R2, ALL) == []
    made = read_rules(text := rules(R2, plugged))
    assert said.partition(": ")[2] in text
    names = [effect(made, seen(port)).get("SYMLINK+=") for port in (*plugged, BOARD_AT_1, LIDAR_AT_2)]
    assert name not in names and len({*names} - {None}) == 2, "the others have theirs"


@pytest.mark.parametrize("serial", ["", "0001", '*", RUN+="/bin/sh', "A?", "a b"])
def test_a_chip_without_a_serial_number_of_its_own_is_known_by_its_place(serial: str) -> None:
    made = read_rules(rules(R2, (board := BOARD_AT_1._replace(serial=serial),)))
    assert effect(made, seen(board)) == MINE | FAST | {"SYMLINK+=": "beeclick"}
    assert effect(made, seen(SECOND)) == MINE | FAST


@pytest.mark.parametrize(
    ("owner", "sudo", "user"),
    [
        ("robot", "", "robot"),
        ("root", "ada", "ada"),
        ("", "ada", "ada"),
        ("robot", "ada", "robot"),
        ("root", "", None),
        ("root", "root", None),
        ("", "", None),
    ],
)
def test_a_robot_never_runs_as_root_by_default(
    owner: str, sudo: str, user: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of(_: Path) -> str:
        if owner:
            return owner
        raise KeyError("uid not found")

    monkeypatch.setattr(Path, "owner", of)
    monkeypatch.setenv("SUDO_USER", sudo)
    if user is not None:
        assert everyday_user(tmp_path) == user
        return
    with pytest.raises(OptionError, match="--user: is missing; must say who the robot runs as"):
        everyday_user(tmp_path)


@pytest.mark.parametrize("name", ["r1", "r2"])
def test_systemds_own_verifiers_have_nothing_to_say_where_they_are_installed(
    name: str, tmp_path: Path
) -> None:
    loaded = fleet(
        robot(1, 'range = "/dev/rplidar"') + robot(2, 'listen = "tls/10.0.0.2:7447"\nrange = "openni"')
    )
    written = write(loaded, loaded.robot(name), tmp_path, program=ACRC, user="root", plugged=ALL)
    read_unit(written.service_file.read_text())
    read_rules(written.rules_file.read_text())
    if shutil.which("systemd-analyze"):
        code, said = verdict("systemd-analyze", "verify", "--man=no", written.service_file)
        assert (code, [line for line in said.splitlines() if str(written.service_file) in line]) == (0, [])
    if shutil.which("udevadm") and verdict("udevadm", "verify", "--help")[0] == 0:  # from systemd 254 on
        assert verdict("udevadm", "verify", "--resolve-names=never", written.rules_file)[0] == 0


def verdict(*command: object) -> tuple[int, str]:
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False, timeout=60
    )
    return done.returncode, done.stdout + done.stderr
