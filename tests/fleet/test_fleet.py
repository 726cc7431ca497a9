"""The fleet file, the keys of a fleet, and the commands fleet keys, units and doctor."""

import ipaddress
import json
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, EllipticCurvePublicKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.verification import PolicyBuilder, Store

from actors.radio.radio_model import RadioSetup
from actors.robot.behaviour.code_permit import Permit
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import read_packet_key
from actors.runtime.isolation.tls import Keys, load_keys
from actors.task.loading import load_task
from actors.user_code import FINDER
from deploy.fleet import doctor
from deploy.fleet.fleet_file import load_fleet, task_folders
from deploy.fleet.keys import FleetKeys, create_keys, parse_hosts, replace_keys
from deploy.hosts import certificates
from deploy.scenario.resolve import robot_setup
from firmware_bridge.ros2.settings import Ros2Base
from tests.cli.test_cli import acrc
from tests.fleet.fleet_texts import HEAD, OFFICE, ROBOT, ROOT, fault, fleet, robot

POWER = "0, -0.5 or -6.3 dBm, or one of them less 10, 20 or 30, which is what the firmware can set"
LISTEN = '"tls/HOST:PORT", such as "tls/0.0.0.0:7447"'


def test_defaults_are_those_of_the_original_robots() -> None:
    assert [robot.address for robot in load_fleet(OFFICE).robots] == [1, 2, 3]
    told = fleet('[strategy]\nreach = 0.5\n[[area]]\nname = "A"\nx = [0, 1]\ny = [2, 3]\n' + ROBOT).adaptation
    assert (told.settings, [area.name for area in told.areas]) == ({"reach": 0.5}, ["A"])
    one = fleet()
    assert (one.radio.pan, one.radio.channel, one.radio.power_db) == (0xBABA, 11, 0.0)
    assert (one.step_ms, one.seed, one.run.strategy) == (100, 1, "none")
    assert one.run.modules == str(ROOT)
    (robot,) = one.robots
    assert (robot.model, robot.sensor, robot.range, robot.listen) == ("turtlebot2", None, None, None)
    assert robot.listen_host is None and not robot.listens_everywhere


def test_every_robot_is_told_the_addresses_of_all_robots_of_the_fleet() -> None:
    office = load_fleet(OFFICE)
    swarm = office.swarm(office.robots[1])
    setup = robot_setup(swarm, swarm.world.robots[0])
    assert (setup.id, setup.address, setup.members) == ("r2", 2, (("r1", 1), ("r2", 2), ("r3", 3)))


def test_paths_are_relative_to_the_file_not_to_the_working_directory(
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
    assert mine.map == str(tmp_path / "maps" / "floor.yaml")
    assert mine.keys == str(tmp_path / "fleets" / "secret")
    assert mine.run.modules == str(tmp_path / "fleets" / "own")
    assert mine.robot_named("r1").model == str(tmp_path / "fleets" / "models" / "wide.toml")


NETWORKED = '[radio]\nnetwork = "tls/10.0.0.5:7450"\n'
ALIKE = '"network" for all robots where radio.network is set, and a port where it is absent'


def test_the_medium_of_robots_without_boards_is_that_of_a_simulated_run_on_the_fleets_map() -> None:
    mine = fleet(NETWORKED + robot(1, 'radio = "network"') + robot(2, 'radio = "network"'))
    defaults = RadioSetup(
        seed=1, step_us=100_000, robots=(("r1", 1), ("r2", 2)), map=mine.map, channel=11, detail="full"
    )
    assert mine.medium == defaults
    more = 'preset = "beeclick"\nwalls = "glass"\nshadowing_db = 3.0\nchannel = 15\n'
    varied = fleet(NETWORKED + more + robot(1, 'radio = "network"')).medium
    assert (varied.preset, varied.walls, varied.shadowing_db, varied.channel) == (
        "beeclick",
        "glass",
        3.0,
        15,
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "robot is missing, but must be written as tables [[robot]]"),
        (
            "step_ms = 15" + ROBOT,
            "step_ms is 15, but must be a multiple of the 10 ms physics sub-step, from 10 to 100",
        ),
        ("[run]\nstrateg = 1" + ROBOT, "unknown key run.strateg; did you mean run.strategy?"),
        ("[radio]\npan = 0xFFFF" + ROBOT, "radio.pan is 65535, but must be a whole number from 0 to 0xFFFE"),
        ("[radio]\npower_db = 1" + ROBOT, f"radio.power_db is 1, but must be {POWER}"),
        (robot(1, 'id = "R1"'), 'robot[0].id is "R1", but must be the id of a robot, such as "r2"'),
        (robot(1, 'adversary = "mute"'), "unknown key robot[0].adversary; known keys of robot[0]: start,"),
        (robot(1, "start = [1, 2]"), "robot[0].start is [1, 2], but must be a pose [x, y, heading]"),
        (ROBOT.replace("places = [[12.2, 5.9]]", ""), "robot[0].places is missing, but must be a list"),
        (
            robot(1, 'base = "kobuki"'),
            'robot[0].base is "kobuki", but must be the path of a port, such as "/dev/kobuki", or a table '
            '[robot.base] with kind = "ros2"',
        ),
        (robot(1, 'range = "kinect"'), 'robot[0].range is "kinect", but must be the path of a lidar\'s port'),
        (robot(1, 'radio = "wifi"'), 'robot[0].radio is "wifi", but must be the path of a port, such as'),
        (robot(1, 'radio = "network"'), f'robot[0].radio is "network", but must be {ALIKE}'),
        (NETWORKED + ROBOT, f'robot[0].radio is "/dev/beeclick", but must be {ALIKE}'),
        (
            NETWORKED.replace("7450", "70000") + ROBOT,
            'radio.network is "tls/10.0.0.5:70000", but must be "tls/HOST',
        ),
        (
            NETWORKED + "power_db = -0.5" + ROBOT,
            "radio.power_db is -0.5, but must be absent where radio.network",
        ),
        (NETWORKED + 'walls = "cheese"' + ROBOT, 'radio.walls is "cheese", but must be '),
        (
            '[radio]\nwalls = "glass"' + ROBOT,
            'radio.walls is "glass", but must be absent where radio.network is',
        ),
        (robot(1, 'listen = "tcp/0.0.0.0:7447"'), f'"tcp/0.0.0.0:7447", but must be {LISTEN}'),
        (robot(1, 'listen = "tls/a b:7447"'), f'robot[0].listen is "tls/a b:7447", but must be {LISTEN}'),
        (robot(1) + robot(1, "address = 2"), 'robot[1].id is a second "r1"; each robot must have its own id'),
        (robot(1) + robot(2, "address = 1"), "robot[1].address: 1 is the address of r1, too"),
        (robot(1, 'range = "/dev/kobuki"'), 'robot[0].range: "/dev/kobuki" is the port of base, too'),
        (
            '[deeco]\nkey = "00112233445566778899aabbccddeeff"' + ROBOT,
            "deeco.key must be absent, as fleet files are not secret; use radio.authenticated = true and the "
            "key of `acrc fleet keys`",
        ),
        ("[deeco]\nhop_limit = 16" + ROBOT, "deeco.hop_limit is 16, but must be a whole number from 1 to 15"),
    ],
)
def test_a_fault_is_one_sentence(text: str, sentence: str) -> None:
    assert sentence in fault(text)
    assert fault(robot(1) + robot(2)) == "nothing was wrong", "ports of different robots may be equal"


def ros2(number: int, keys: str = "", more: str = "") -> str:
    """Return a robot's table with a ROS 2 base."""
    return robot(number, f'base = {{ kind = "ros2"{keys} }}\n{more}')


ROUTER = ', router = "tcp/10.0.0.1:7447"'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (robot(1, "base = {}"), 'robot[0].base.kind is missing, but must be "ros2"'),
        (robot(1, 'base = { kind = "ros1" }'), 'robot[0].base.kind is "ros1", but must be "ros2"'),
        (
            ros2(1, ', namespce = "/r1"'),
            "unknown key robot[0].base.namespce; did you mean robot[0].base.namespace?",
        ),
        (
            ros2(1, ', namespace = "r1"'),
            'robot[0].base.namespace is "r1", but must be empty, or a namespace with a leading slash, such '
            'as "/r1"',
        ),
        (
            ros2(1, ', router = "tcp/10.0.0.1:65536"'),
            'robot[0].base.router is "tcp/10.0.0.1:65536", but must be an endpoint such as '
            '"tcp/192.168.1.21:7447"',
        ),
        (
            ros2(1, ', bridge = "dds"'),
            'robot[0].base.bridge is "dds", but must be "rmw_zenoh" or "ros2dds"',
        ),
        (
            ros2(1, ', bridge = "ros2dds", domain = 3'),
            'robot[0].base.domain is 3, but must be absent where bridge = "ros2dds", which does not use it',
        ),
        (
            ros2(1, ', command = "twist"'),
            'robot[0].base.command is "twist", but must be "Twist" or "TwistStamped"',
        ),
        (
            ros2(1, ', topics = { scan = "a b" }'),
            'robot[0].base.topics.scan is "a b", but must be the name of a topic, such as "scan" or '
            '"/r1/scan"',
        ),
        (
            ros2(1, ', topics = { odom = "scan" }'),
            "robot[0].base.topics.odom is /scan at tcp/127.0.0.1:7447, which is scan of r1, too; correct "
            "router, domain, namespace or topics",
        ),
        (
            ros2(1, more='range = "/dev/rplidar"'),
            'robot[0].range is "/dev/rplidar", but must be absent where base is ROS 2 topics, which include '
            "the scans",
        ),
        (
            ros2(1, ROUTER) + ros2(2, ROUTER),
            "robot[1].base.topics.scan is /scan at tcp/10.0.0.1:7447, which is scan of r1, too; correct "
            "router, domain, namespace or topics",
        ),
    ],
)
def test_a_fault_of_a_ros_2_base_is_one_sentence(text: str, sentence: str) -> None:
    assert fault(text) == sentence


def test_ros_2_robots_differ_in_router_domain_or_namespace() -> None:
    mixed = fleet(
        robot(1)
        + ros2(2)
        + ros2(3)
        + ros2(4, ROUTER)
        + ros2(5, f"{ROUTER}, domain = 5")
        + ros2(6, f'{ROUTER}, namespace = "/r6", topics = {{ command = "/r6/cmd" }}')
    )
    assert [one.extras for one in mixed.robots[:2]] == [
        ("base", "hardware"),
        ("base", "hardware", "logs"),
    ], "routers on each robot's own computer have equal addresses"
    last = mixed.robots[5].base
    assert isinstance(last, Ros2Base)
    assert (last.topic("scan"), last.topic("command")) == ("/r6/scan", "/r6/cmd")


BEACONS = """task = { use = "tests.field_trial.beacons:Beacons" }
run = { strategy = "tests.field_trial.beacons:listen", modules = "." }
"""


def test_robots_of_a_fleet_have_items_of_its_task(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FINDER, "task_folders", (ROOT,))
    own = robot(1).replace("places = [[12.2, 5.9]]", 'beacons = ["north", ""]')
    mine = fleet(BEACONS + own)
    world = mine.swarm(mine.robots[0]).world
    assert (mine.robots[0].items, world.robots[0].items) == (("north", ""), ("north", ""))
    assert (world.task.use, world.task.declaration.item) == ("tests.field_trial.beacons:Beacons", "beacon")
    *_, found = doctor.check_floor(mine, mine.robots[0])
    assert (found.subject, found.ok, found.text) == ("beacons", False, 'beacon 1 is "", but must have a name')
    assert task_folders(mine, Permit((ROOT,))) == (ROOT,) and task_folders(fleet(), Permit()) == ()
    unknown = "unknown key robot[0].places; known keys of robot[0]: start, beacons, id, model"
    assert fault(BEACONS + robot(1)).startswith(unknown)
    wrong = own.replace('["north", ""]', "[[1, 2]]")
    assert fault(BEACONS + wrong).startswith("robot[0].beacons[0] is [1, 2]: ")
    assert fault(BEACONS + own.replace("beacons", "items")) == (
        "robot[0].items is not a key; the task's key is beacons"
    )
    monkeypatch.setattr(FINDER, "task_folders", ())
    load_task.cache_clear()
    assert "its module is not installed; name its folder with --modules DIR" in fault(BEACONS + own)


def test_errors_name_a_missing_or_invalid_file(tmp_path: Path) -> None:
    file = tmp_path / "f.toml"
    with pytest.raises(AcrcError, match=f"{file}: the fleet file cannot be read: No such file or directory"):
        load_fleet(file)
    file.write_text(HEAD + "= 3")
    with pytest.raises(AcrcError, match=rf"{file}: invalid TOML: Invalid statement \(at line 2, column 1"):
        load_fleet(file)
    assert fault(ROBOT, head="").startswith("map is missing, but must be the path of a map's YAML file")


@pytest.fixture
def office(tmp_path: Path) -> Path:
    """Return a copy of the shipped fleet file in a writable folder."""
    text = OFFICE.read_text().replace("../maps", str(ROOT / "maps"))
    file = tmp_path / "office.toml"
    file.write_text(text)
    return file


def test_keys_are_written_beside_the_fleet_file_with_a_destination_for_each(office: Path) -> None:
    code, out, err = acrc("fleet", "keys", str(office), "--host", "r1=10.0.0.1", "--host", "r2=10.0.0.2")
    assert code == 0
    assert err.startswith("acrc: r3 listens at all its addresses, but its certificate is valid for names")
    keys = office.parent / "office-keys"
    assert f"{keys}/r1\n  copy to r1:{keys}/r1; valid for r1, r1.local, 10.0.0.1\n" in out
    for machine in ("r1", "r2", "r3", "operator"):
        assert stat.S_IMODE(load_keys(keys / machine).private_key.stat().st_mode) == 0o600
    code, out, _ = acrc("fleet", "keys", str(office), "--revoke", "r2", "--revoke", "operator")
    (aside,) = office.parent.glob("office-keys.until-*")
    assert code == 0 and out.splitlines()[-1] == f"The old keys are in {aside}; delete them after that."


def test_units_are_written_but_not_installed(office: Path, tmp_path: Path) -> None:
    out = tmp_path / "units"
    code, said, err = acrc("fleet", "units", str(office), "--robot", "r2", "--out", str(out), "--user", "me")
    assert code == 0
    assert all("found, name not assigned; plug it in" in line for line in err.splitlines())
    assert sorted(path.name for path in out.iterdir()) == ["60-acrc.rules", "acrc-r2.service"]
    service = (out / "acrc-r2.service").read_text()
    assert f"\nExecStart={ROOT}/acrc fleet onboard {office} --robot r2\n" in service
    assert "\nUser=me\n" in service
    assert f"  sudo install -m 644 {out}/60-acrc.rules /etc/udev/rules.d/\n" in said
    assert "  sudo systemctl enable --now acrc-r2.service\n" in said


def test_doctor_exits_with_1_if_a_check_fails(office: Path) -> None:
    code, out, _ = acrc("fleet", "doctor", str(office), "--robot", "r2", "--json")
    report = json.loads(out)
    assert (code, report["robot"], report["ok"]) == (1, "r2", False)
    assert any("no such port, and no Kobuki found" in one["text"] for one in report["findings"])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("keys", "{}", "--days", "0"), "--days: 0; must be a whole number from 1 to 3650"),
        (("keys", "{}", "--revoke", "r9"), '{}: no robot "r9" in the fleet; give one of r1, r2, r3'),
        (("units", "{}", "--robot", "r9"), '{}: no robot "r9" in the fleet; give one of r1, r2, r3'),
        (("doctor", "{}"), "--robot: missing; give the robot that this computer is: r1, r2, r3"),
        (
            ("doctor", "--robot", "r2"),
            "--robot: r2 needs a fleet file; use acrc fleet doctor fleet.toml --robot r2",
        ),
    ],
)
def test_a_wrong_command_line_is_one_sentence(words: tuple[str, ...], sentence: str, office: Path) -> None:
    code, out, err = acrc("fleet", *(word.format(office) for word in words))
    assert (code, out, err) == (2, "", f"acrc: {sentence.format(office)}\n")


NOW = datetime(2030, 5, 1, 12, tzinfo=UTC)
OF_FOUR = fleet(
    robot(1, 'listen = "tls/0.0.0.0:7447"')
    + robot(2, 'listen = "tls/192.168.1.12:7447"')
    + robot(3, 'listen = "tls/r3.office.example:7447"')
    + robot(4, 'listen = "tls/[fe80::1]:65535"')
)


def made(out: Path) -> FleetKeys:
    return create_keys(OF_FOUR, out, {"r1": ["192.168.1.11", "fd00::11"]}, now=NOW, days=30)


def certificate(folder: Path, name: str = "certificate.pem") -> x509.Certificate:
    return certificates.load_certificate((folder / name).read_bytes())


def test_every_machine_gets_its_own_folder_without_the_authoritys_key(tmp_path: Path) -> None:
    keys = made(tmp_path / "keys")
    assert keys.home == tmp_path / "keys" / "authority"
    assert keys.valid_until == datetime(2030, 5, 31, 12, tzinfo=UTC)
    assert [(one.machine, one.folder) for one in keys.machines] == [
        (name, tmp_path / "keys" / name) for name in ("r1", "r2", "r3", "r4", "operator")
    ]
    assert sorted(path.name for path in keys.home.iterdir()) == ["authority.pem", "key.pem"]
    for one in keys.machines:
        assert load_keys(one.folder) == Keys(
            one.folder / "authority.pem", one.folder / "certificate.pem", one.folder / "key.pem"
        )
        assert (one.folder / "authority.pem").read_bytes() == (keys.home / "authority.pem").read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["keys"]
    folders = [keys.home, *(one.folder for one in keys.machines)]
    private = [folder / "key.pem" for folder in folders]
    assert {stat.S_IMODE(path.stat().st_mode) for path in private} == {0o600}
    assert {stat.S_IMODE(path.stat().st_mode) for path in folders} == {0o700}
    assert len({path.read_bytes() for path in private}) == 6
    packet_keys = sorted(keys.home.parent.glob("*/packets.key"))
    assert [path.parent.name for path in packet_keys] == ["r1", "r2", "r3", "r4"]
    assert {stat.S_IMODE(path.stat().st_mode) for path in packet_keys} == {0o600}
    assert len({read_packet_key(path) for path in packet_keys}) == 1, "one key of all robots"
    assert (tmp_path / "keys" / ".gitignore").read_text().endswith("\n*\n")


def test_names_purposes_hosts_and_dates_are_in_the_certificates(tmp_path: Path) -> None:
    keys = made(tmp_path / "keys")
    authority = certificate(keys.home, "authority.pem")
    assert certificates.common_name(authority) == "fleet some"
    constraints = authority.extensions.get_extension_for_class(x509.BasicConstraints).value
    assert constraints == x509.BasicConstraints(ca=True, path_length=0)
    hosts = {
        "r1": ("r1", "r1.local", "192.168.1.11", "fd00::11"),
        "r2": ("r2", "r2.local", "192.168.1.12"),
        "r3": ("r3", "r3.local", "r3.office.example"),
        "r4": ("r4", "r4.local", "fe80::1"),
        "operator": (),
    }
    assert {one.machine: one.hosts for one in keys.machines} == hosts
    verifier = PolicyBuilder().store(Store([authority])).time(NOW)
    for one in keys.machines:
        own = certificate(one.folder)
        own.verify_directly_issued_by(authority)
        assert certificates.common_name(own) == one.machine
        assert own.not_valid_before_utc == NOW - timedelta(days=1)
        assert own.not_valid_after_utc == keys.valid_until
        assert not own.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
        purpose = own.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert list(purpose) == [certificates.CLIENT if one.machine == "operator" else certificates.SERVER]
        public = own.public_key()
        assert isinstance(public, EllipticCurvePublicKey) and isinstance(public.curve, SECP256R1)
        private = load_pem_private_key((one.folder / "key.pem").read_bytes(), password=None)
        assert private.public_key() == public
        for host in one.hosts:
            verifier.build_server_verifier(certificates.general_name(host)).verify(own, [])
    address = x509.IPAddress(ipaddress.ip_address("192.168.1.12"))
    with pytest.raises(x509.verification.VerificationError):
        verifier.build_server_verifier(address).verify(certificate(tmp_path / "keys" / "r1"), [])
    assert [one.listens_unnamed for one in keys.machines] == [False] * 5
    bare = create_keys(OF_FOUR, tmp_path / "bare", {}, now=NOW, days=30)
    assert [one.listens_unnamed for one in bare.machines] == [True, False, False, False, False]


def test_keys_are_never_overwritten(tmp_path: Path) -> None:
    keys = made(tmp_path / "keys")
    before = (keys.home / "key.pem").read_bytes()
    with pytest.raises(AcrcError, match=f"{tmp_path}/keys: already exists; move it away to create"):
        made(tmp_path / "keys")
    assert (keys.home / "key.pem").read_bytes() == before
    (keys.machines[1].folder / "key.pem").unlink()
    with pytest.raises(AcrcError, match=f"{tmp_path}/keys/r2/key.pem cannot be read"):
        load_keys(keys.machines[1].folder)
    with pytest.raises(AcrcError, match=f"{tmp_path}/none: no keys to revoke"):
        replace_keys(OF_FOUR, tmp_path / "none", ["r2"], {}, now=NOW, days=30)


@pytest.mark.parametrize("word", ["r2", "r2=", "r2=a b", "r2=-a"])
def test_invalid_hosts_are_refused(word: str) -> None:
    with pytest.raises(AcrcError, match=r"^--host: .*; must be a robot's id and its name or address, such"):
        parse_hosts([word], OF_FOUR)
    names = parse_hosts(["r2=a.example", "r2=10.0.0.2", "r1=fd00::1"], OF_FOUR)
    assert names == {"r2": ["a.example", "10.0.0.2"], "r1": ["fd00::1"]}


def test_machines_with_new_keys_reject_revoked_ones(tmp_path: Path) -> None:
    old = made(tmp_path / "keys")
    later = NOW + timedelta(days=3)
    new, aside = replace_keys(OF_FOUR, tmp_path / "keys", ["r2"], {"r4": ["10.0.0.4"]}, now=later, days=30)
    assert aside == tmp_path / "keys.until-20300504-120000"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["keys", aside.name]
    assert [one.hosts for one in new.machines[:3]] == [one.hosts for one in old.machines[:3]]
    assert set(new.machines[3].hosts) == {"r4", "r4.local", "fe80::1", "10.0.0.4"}
    packet_keys = [read_packet_key(folder / "r1" / "packets.key") for folder in (tmp_path / "keys", aside)]
    assert packet_keys[0] != packet_keys[1]
    authority = certificate(new.home, "authority.pem")
    verifier = PolicyBuilder().store(Store([authority])).time(later)
    for one in new.machines[:-1]:
        certificate(one.folder).verify_directly_issued_by(authority)
        host = certificates.general_name(one.machine)
        verifier.build_server_verifier(host).verify(certificate(one.folder), [])
        with pytest.raises(x509.verification.VerificationError):
            verifier.build_server_verifier(host).verify(certificate(aside / one.machine), [])
    certificate(tmp_path / "keys" / "operator").verify_directly_issued_by(authority)
    with pytest.raises(InvalidSignature):
        certificate(aside / "operator").verify_directly_issued_by(authority)
