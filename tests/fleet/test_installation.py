"""Installation on a robot: bundle, service and udev rules."""

import fnmatch
import json
import os
import platform
import re
import shlex
import shutil
import stat
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import Mock

import msgspec
import pytest

from acrc_testbed.recordings import record_replay
from actors.installation import version
from actors.installation.repository import PACKAGES
from actors.installation.usage import OptionError
from actors.robot.behaviour.code_permit import INSTALLED, Permit
from actors.runtime.errors import AcrcError
from deploy.fleet import keys, robot_bundle
from deploy.fleet.fleet_file import load_fleet
from deploy.fleet.robot_bundle import RobotBundle
from deploy.fleet.units import UsbPort, default_user, service_text, udev_rules, unassigned, write_units
from firmware_bridge.ros2.settings import Ros2Base
from tests.fleet.fleet_texts import BOARD_AT_1, KOBUKI_AT_0, LIDAR_AT_2, OFFICE, ROOT, fleet, robot
from tests.in_process import acrc
from tests.onboard.standstill_rig import MAP, Rig

ACRC = ROOT / "acrc"
ALL = (KOBUKI_AT_0, BOARD_AT_1, LIDAR_AT_2)


def seen(port: UsbPort) -> dict[str, str]:
    """Return a port's attributes as seen by udev rules."""
    found = {"SUBSYSTEM": "tty", "idVendor": port.vendor, "idProduct": port.product, "KERNELS": port.socket}
    return found | ({"serial": port.serial} if port.serial else {})


R2 = load_fleet(OFFICE).robot_named("r2")
KOBUKI, FTDI, CP2102 = map(seen, ALL)
MINE = {"GROUP=": "dialout", "MODE=": "0660", "TAG+=": "systemd"}
RULE_TOKEN = r'([A-Z]+(?:\{[A-Za-z0-9_/.]+\})?(?:==|!=|\+=|=))"([^"\\]*)"'
FAST = {"ATTR{device/latency_timer}=": "1"}


Rule = dict[str, str]


def read_unit(text: str) -> dict[str, dict[str, list[str]]]:
    """Return values by section and key."""
    sections: dict[str, dict[str, list[str]]] = {}
    for line in text.splitlines():
        if line.startswith("["):
            current = sections.setdefault(line.strip("[]"), {})
        elif line and not line.startswith("#"):
            key, _, value = line.partition("=")
            current.setdefault(key, []).append(value)
    return sections


def words(line: str) -> list[str]:
    """Split and unescape a command line as systemd does."""
    return [re.sub(r"(%|\$)\1", r"\1", word) for word in shlex.split(line)]


def read_rules(text: str) -> list[Rule]:
    """Return the rules, each as values by `KEY operator` or `KEY{attribute} operator`."""
    lines = (line for line in text.splitlines() if line and not line.startswith("#"))
    rules = [[re.fullmatch(RULE_TOKEN, token) for token in line.split(", ")] for line in lines]
    assert all(token is not None for rule in rules for token in rule), text
    return [{token[1]: token[2] for token in rule if token is not None} for rule in rules]


def effect(rules: list[Rule], device: Rule, action: str = "add") -> Rule:
    """Apply the rules to a device with these attributes (`SUBSYSTEM`, `idVendor`, …), as udev does."""
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
    return read_unit(service_text(loaded, loaded.robot_named("r2"), program=program, user="robot"))


def test_service_starts_the_robot_stops_the_wheels_at_exit_and_limits_restarts() -> None:
    sections = unit()
    service = sections["Service"]
    assert words(service["ExecStart"][0]) == [
        str(ACRC), "fleet", "onboard", str(OFFICE), "--robot", "r2"
    ]  # fmt: skip
    expected = {
        "User": "robot", "SupplementaryGroups": "dialout", "Restart": "on-failure",
        "SuccessExitStatus": "143", "StandardOutput": "journal", "SyslogIdentifier": "acrc-r2",
        "Type": "notify", "NotifyAccess": "main", "TimeoutStartSec": "900", "WatchdogSec": "20",
    }  # fmt: skip
    assert {key: service[key] for key in expected} == {key: [value] for key, value in expected.items()}
    assert sections["Unit"]["StartLimitBurst"] == ["5"]
    assert sections["Unit"]["StartLimitIntervalSec"] == ["300"]
    assert sections["Install"]["WantedBy"] == ["multi-user.target"]
    python, *stop = words(service["ExecStopPost"][0])
    assert python == f"-{ROOT}/.venv/bin/python"
    guardian = ROOT / "firmware_bridge" / "kobuki" / "guardian.py"
    assert stop == ["-I", "-S", str(guardian), "alone", "/dev/kobuki"]
    assert guardian.is_file()


def test_service_waits_for_devices_and_for_the_network_only_with_a_specific_address() -> None:
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


def test_service_allows_devices_namespaces_and_compiled_kernels() -> None:
    own = unit()["Service"]
    assert own["DevicePolicy"] == ["closed"]
    assert own["DeviceAllow"] == ["char-ttyUSB rw", "char-ttyACM rw"]
    assert own["ReadWritePaths"] == [str(ROOT)]
    kernels = {"RestrictNamespaces", "MemoryDenyWriteExecute", "SystemCallFilter"}
    assert not {"PrivateDevices", "PrivateNetwork", "PrivateUsers", *kernels} & own.keys()
    assert unit('range = "openni"')["Service"]["DeviceAllow"][2:] == ["char-usb_device rw"]


def test_a_ros_2_base_has_a_network_in_place_of_a_port() -> None:
    ros2 = 'base = { kind = "ros2", router = "tcp/10.0.0.1:7447" }'
    sections = unit(ros2)
    assert sections["Unit"]["Wants"] == ["dev-beeclick.device network-online.target"]
    assert sections["Unit"]["After"] == ["time-set.target network-online.target dev-beeclick.device"]
    *_, verb, settings = words(sections["Service"]["ExecStopPost"][0])
    base = fleet(robot(1, ros2)).robots[0].base
    assert (verb, msgspec.json.decode(settings, type=Ros2Base)) == ("alone", base)
    made = read_rules(udev_rules(fleet(robot(1, ros2)).robot_named("r1"), ALL))
    assert effect(made, KOBUKI) == MINE | FAST, "an FTDI chip without a name"
    assert effect(made, FTDI) == MINE | FAST | {"SYMLINK+=": "beeclick"}


def test_special_characters_of_systemd_in_paths_are_escaped() -> None:
    folder = Path('/home/a b/50% "off" $HOME/back\\slash')
    own = unit(path=folder / "fleet.toml", program=folder / "acrc")["Service"]
    assert words(own["ExecStart"][0]) == [
        str(folder / "acrc"), "fleet", "onboard", str(folder / "fleet.toml"), "--robot", "r2"
    ]  # fmt: skip
    assert own["ReadWritePaths"] == [r'"/home/a b/50%% \"off\" $HOME/back\\slash"']


def test_invalid_user_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(AcrcError, match="--user: 'me\nExecStart=/bin/sh'; must be the name of a user of"):
        write_units(load_fleet(OFFICE), R2, tmp_path, program=ACRC, user="me\nExecStart=/bin/sh", plugged=())


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
    made = read_rules(udev_rules(R2, ALL))
    assert effect(made, device) == expected
    assert effect(made, device, action="remove") == {}


@pytest.mark.parametrize("port", ["/dev/ttyACM0", "/dev/pts/3", "/dev/serial/by-id/x", "/tmp/k", "/dev/a b"])
def test_rules_do_not_assign_kernel_names_or_invalid_names(port: str) -> None:
    text = udev_rules(fleet(robot(1, f'base = "{port}"')).robot_named("r1"), ALL)
    assert [rule["SYMLINK+="] for rule in read_rules(text) if "SYMLINK+=" in rule] == ["beeclick"]
    camera = fleet(robot(1, 'range = "openni"')).robot_named("r1")
    assert effect(read_rules(udev_rules(camera, ALL)), CP2102) == {}


SECOND = UsbPort("/dev/ttyUSB3", "0403", "6001", "B1", "1-1.4")


@pytest.mark.parametrize(
    ("plugged", "name", "why"),
    [
        ((KOBUKI_AT_0, LIDAR_AT_2), "beeclick", "no BEE-click board found"),
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
def test_ambiguous_and_missing_chips_get_no_name(plugged: tuple[UsbPort, ...], name: str, why: str) -> None:
    (said,) = unassigned(R2, plugged)
    assert said.startswith(f"/dev/{name}: {why}") and unassigned(R2, ALL) == []
    made = read_rules(text := udev_rules(R2, plugged))
    assert said.partition(": ")[2] in text
    names = [effect(made, seen(port)).get("SYMLINK+=") for port in (*plugged, BOARD_AT_1, LIDAR_AT_2)]
    assert name not in names and len({*names} - {None}) == 2, "other devices keep their names"


@pytest.mark.parametrize("serial", ["", "0001", '*", RUN+="/bin/sh', "A?", "a b"])
def test_a_chip_without_unique_serial_number_is_identified_by_its_socket(serial: str) -> None:
    made = read_rules(udev_rules(R2, (board := BOARD_AT_1._replace(serial=serial),)))
    assert effect(made, seen(board)) == MINE | FAST | {"SYMLINK+=": "beeclick"}
    assert effect(made, seen(SECOND)) == MINE | FAST


def test_a_robot_never_runs_as_root_by_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def user(owner: str | Exception, sudo: str) -> str:
        monkeypatch.setattr(Path, "owner", Mock(side_effect=[owner]))
        monkeypatch.setenv("SUDO_USER", sudo)
        return default_user(tmp_path)

    unknown = KeyError("uid not found")
    assert (user("robot", "ada"), user("root", "ada"), user(unknown, "ada")) == ("robot", "ada", "ada")
    for owner, sudo in (("root", "root"), (unknown, "")):
        with pytest.raises(OptionError, match="--user: missing; this clone belongs to root"):
            user(owner, sudo)


@pytest.mark.parametrize("name", ["r1", "r2"])
def test_systemds_verifiers_report_no_fault(name: str, tmp_path: Path) -> None:
    loaded = fleet(
        robot(1, 'range = "/dev/rplidar"') + robot(2, 'listen = "tls/10.0.0.2:7447"\nrange = "openni"')
    )
    written = write_units(loaded, loaded.robot_named(name), tmp_path, program=ACRC, user="root", plugged=ALL)
    read_unit(written.service_file.read_text())
    read_rules(written.rules_file.read_text())
    if shutil.which("systemd-analyze"):
        code, said = verdict("systemd-analyze", "verify", "--man=no", written.service_file)
        assert (code, [line for line in said.splitlines() if str(written.service_file) in line]) == (0, [])
    if shutil.which("udevadm") and verdict("udevadm", "verify", "--help")[0] == 0:  # from systemd 254 on
        assert verdict("udevadm", "verify", "--resolve-names=never", written.rules_file)[0] == 0


def verdict(*command: object) -> tuple[int, str]:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stdout + done.stderr


OWN = "from cleaning.strategies.none import behaviour\nimport helper\n"
LINKS = {"distributions/deeco/LICENSE": "../../LICENSE", "distributions/deeco/deeco": "../../deeco"}
WHEELS = {"wheels/tiny-1.0-py3-none-any.whl": (b"a wheel", 0o644)}


class SmallClone:
    """A git repository of a few files, and a fleet with keys."""

    def __init__(self, folder: Path) -> None:
        self.root, self.office = folder / "clone", folder / "office.toml"
        for name in PACKAGES:
            (self.root / name).mkdir(parents=True)
            (self.root / name / "py.typed").touch()
        for name in robot_bundle._ROOT_FILES:
            (self.root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, self.root / name)
        for name, target in LINKS.items():
            (self.root / name).symlink_to(target)
        (self.root / "actors" / "core.py").touch()
        (self.root / "actors" / "link.py").symlink_to("../acrc")
        for words in (("init", "-q"), ("add", ".")):
            subprocess.run(["git", *words], cwd=self.root, check=True)
        (self.root / "runs.py").touch()
        self.office.write_text(OFFICE.read_text().replace("../maps", "maps"))
        shutil.copytree(ROOT / "maps", folder / "maps")
        fleet = load_fleet(self.office)
        keys.create_keys(fleet, Path(fleet.keys), {}, now=datetime.now(UTC), days=1)

    def bundle(self, out: Path, permit: Permit | None = None) -> RobotBundle:
        fleet, permit = load_fleet(self.office), permit or Permit()
        return robot_bundle.write_bundle(
            self.root, fleet, "r2", permit, machine="aarch64", python="3.12", out=out
        )


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SmallClone:
    monkeypatch.setattr(robot_bundle, "_wheels", lambda *_: WHEELS)
    return SmallClone(tmp_path)


def members(file: Path) -> dict[str, tarfile.TarInfo]:
    with tarfile.open(file) as archive:
        return {one.name.removeprefix("acrc-r2/"): one for one in archive}


def content(file: Path, name: str) -> str:
    with tarfile.open(file) as archive:
        found = archive.extractfile(f"acrc-r2/{name}")
        assert found is not None
        return found.read().decode()


def test_bundle_contains_program_wheels_configuration_and_private_keys(clone: SmallClone) -> None:
    out = clone.root.parent / "b.tar"
    (clone.root / "actors" / "core.py").write_text("pass\n")
    made = clone.bundle(out)
    inside = members(out)
    private = {f"fleets/office-keys/r2/{name}.pem" for name in ("authority", "certificate", "key")}
    configuration = {"fleets/office.toml", "fleets/maps/corridor.yaml", "fleets/maps/corridor.png"}
    packages = {f"{name}/py.typed" for name in PACKAGES}
    program = {*robot_bundle._ROOT_FILES, *packages, *WHEELS, *LINKS, "COMMIT", "actors/core.py"}
    assert inside.keys() == program | private | configuration
    assert {name: one.linkname for name, one in inside.items() if one.issym()} == LINKS
    assert content(out, "actors/core.py") == "pass\n", "uncommitted changes are included"
    assert content(out, "fleets/office.toml") == clone.office.read_text()
    assert {name for name, one in inside.items() if one.mode == 0o600} == private
    assert [name for name, one in inside.items() if one.mode == 0o755] == ["acrc"]
    assert {(one.uid, one.gid, one.uname) for one in inside.values()} == {(0, 0, "")}
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    assert (made.fleet, made.own_code, made.files) == ("fleets/office.toml", False, len(inside))
    assert clone.bundle(out.with_name("c.tar")).sha256 == made.sha256
    (clone.root / "actors" / "core.py").write_text("")
    assert clone.bundle(out.with_name("d.tar")).sha256 != made.sha256


@pytest.fixture
def forgotten() -> Iterator[None]:
    """Unload modules whose names other tests use, too."""
    yield
    for name in ("mine", "helper"):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("forgotten")
def test_bundle_contains_a_users_strategy_and_its_imports(clone: SmallClone, tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.mkdir()
    for name, text in (("mine.py", OWN), ("helper.py", ""), ("other.py", "raise ValueError")):
        (own / name).write_text(text)
    text = clone.office.read_text().replace('strategy = "chapter"', 'strategy = "mine:behaviour"')
    text = text.replace("[radio]", "[radio]\nauthenticated = true")
    for given, left in (("adoption_distance", "# "), ("listen =", "# listen =")):
        text = text.replace(given, left)
    clone.office.write_text(text)
    (clone.root / "requirements.txt").write_text("pandas\nnetworkx\n")
    made = clone.bundle(tmp_path / "b.tar", Permit((own,)))
    assert (made.lacks, made.own_code) == ("pandas, networkx", True)
    names = members(tmp_path / "b.tar")
    assert [name for name in names if name.startswith("modules/")] == ["modules/helper.py", "modules/mine.py"]
    assert [(name, one.mode) for name, one in names.items() if "office-keys" in name] == [
        ("fleets/office-keys/r2/packets.key", 0o600)
    ], "a robot that does not listen needs no certificate"


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--robot", "r9"), 2, '{office}: no robot "r9" in the fleet; give one of r1, r2, r3'),
        (("--machine", "mips"), 2, "--machine: mips; must be x86-64 or aarch64"),
        (("--python", "3.10"), 2, "--python: 3.10; must be one of 3.11, 3.12, 3.13, 3.14"),
        (("--out", "."), 2, "--out: . is a directory; give a file"),
    ],
)
def test_wrong_options_are_one_line(
    options: tuple[str, ...], code: int, said: str, clone: SmallClone
) -> None:
    out = clone.root.parent / "b.tar"
    done = acrc("fleet", "bundle", clone.office, "--robot", "r2", "--out", out, *options)
    assert (done.returncode, done.stderr) == (code, f"acrc: {said.format(office=clone.office)}\n")
    assert not out.exists()


@pytest.mark.parametrize(
    ("replaced", "by", "message"),
    [
        ('"maps/corridor.yaml"', '"{}/maps/corridor.yaml"', "corridor.yaml is an absolute path"),
        ("start = [17.5, 5.0, 0.0]", "start = [0.0, 0.0, 0.0]", "^start: robot 'r2' .* is not on free floor"),
        ('id = "r3"', 'id = "r3"', r"^keys: .*authority\.pem cannot be read"),
    ],
)
def test_faulty_configurations_are_refused(replaced: str, by: str, message: str, clone: SmallClone) -> None:
    if replaced == by:
        (clone.office.with_name("office-keys") / "r2" / "authority.pem").unlink()
    by = by.replace("{}", str(clone.office.parent))
    clone.office.write_text(clone.office.read_text().replace(replaced, by))
    with pytest.raises(AcrcError, match=message):
        clone.bundle(clone.root.parent / "b.tar")
    assert not (clone.root.parent / "b.tar").exists()


def test_missing_wheels_are_reported_in_one_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name, value in {"CONFIG_FILE": "/dev/null", "NO_INDEX": "1", "FIND_LINKS": str(tmp_path)}.items():
        monkeypatch.setenv(f"PIP_{name}", value)
    text = f"# [base]\ntiny==1.0 --hash=sha256:{'0' * 64}\n# [hardware]\n# [build]\n"
    with pytest.raises(
        AcrcError, match=r"cannot be downloaded: No matching distribution found for tiny==1\.0"
    ):
        robot_bundle._wheels(text, ("base", "hardware"), "x86-64", "3.13")


def test_the_bundle_of_a_ros_2_robot_has_the_wheel_of_its_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    downloaded: list[str] = []
    monkeypatch.setattr(robot_bundle, "download", lambda _, pinned, *__: downloaded.extend(pinned))
    constraints = (ROOT / "constraints.txt").read_text()
    for one, expected in ((robot(1), False), (robot(1, 'base = { kind = "ros2" }'), True)):
        downloaded.clear()
        robot_bundle._wheels(constraints, fleet(one).robots[0].extras, "aarch64", "3.12")
        assert any(pin.startswith("rosbags==") for pin in downloaded) is expected
        assert any(pin.startswith("pyserial==") for pin in downloaded)


def test_a_bundles_program_reports_its_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / version.COMMIT).write_text("abc+\n")
    monkeypatch.setattr(version, "REPOSITORY", tmp_path)
    assert version.software_version.__wrapped__() == "abc+"


@pytest.mark.parametrize("minor", version.MINORS)
def test_every_pin_of_a_robot_is_read_with_its_hashes(minor: int) -> None:
    text = (ROOT / "constraints.txt").read_text()
    found = version.sections(text, minor)
    names = [pin.name for section in ("build", "base", "hardware") for pin in found[section]]
    assert len(names) == len(set(names)) and {"numba", "setuptools", "pyserial", "cryptography"} <= set(names)
    assert all(pin.hashes for section in found.values() for pin in section)
    listed = version.requirements(text, minor, ("build", "base", "hardware"))
    assert len(listed) == len(names) and json.dumps(listed).count("; python") == 0


class BundledRig(Rig):
    """Local emulated devices, and a robot run from its bundle in a network namespace without interfaces."""

    def onboard(self) -> list[str]:
        words = (self.folder / "acrc-r1" / "acrc", "fleet", "onboard", "fleets/fleet.toml")
        place = ("env", "-C", str(self.folder / "acrc-r1"), "unshare", "--map-root-user", "--net")
        return [*place, *map(str, words), "--robot", "r1", "--out", str(self.out)]


@pytest.mark.claim("bundle")
@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_a_robot_is_installed_and_drives_without_a_network(tmp_path: Path, full: bool) -> None:
    """Test an offline installation; downloading the wheels needs a network or PIP_FIND_LINKS."""
    rig = BundledRig(tmp_path)
    for file in (MAP, MAP.with_suffix(".png")):
        shutil.copy(file, tmp_path)
    machine = {"x86_64": "x86-64"}.get(platform.machine(), platform.machine())
    fleet, out = load_fleet(rig.write_fleet(MAP.name)), tmp_path / "r1.tar"
    python = f"3.{sys.version_info.minor}"
    robot_bundle.write_bundle(ROOT, fleet, "r1", INSTALLED, machine=machine, python=python, out=out)
    subprocess.run(["tar", "-xf", out, "-C", tmp_path], check=True)
    words = ("acrc-r1/acrc", "fleet", "units", "acrc-r1/fleets/fleet.toml", "--robot", "r1", "--user", "acrc")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    offline = ("unshare", "--map-root-user", "--net")
    subprocess.run([*offline, *words, "--out", "units"], cwd=tmp_path, env=environment, check=True)
    assert f"{tmp_path}/acrc-r1/acrc fleet onboard" in (tmp_path / "units" / "acrc-r1.service").read_text()
    with rig:
        rig.until_driving(900.0)  # compiles the numeric kernels first
        way = rig.where().way
        rig.standing(60.0 if full else 5.0)
        assert rig.where().way > way
    assert record_replay.replay_actor(rig.out, "r1").outputs > 20
