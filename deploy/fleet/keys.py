"""Keys of a fleet: a certificate authority, and a folder with key and certificate for each machine."""

import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

from actors.installation.usage import wrong_value
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.credentials import PACKET_KEY_FILE, write_secret
from actors.runtime.isolation.tls import AUTHORITY_FILE, CERTIFICATE_FILE, OPERATOR, RADIO_STATION
from deploy.fleet.fleet_file import Fleet, FleetRobot
from deploy.hosts import certificates
from deploy.hosts.address import host_and_port

AUTHORITY_FOLDER: Final = "authority"
"""Folder of the certificate authority; do not copy it to robots."""
MAX_DAYS: Final = 3650
_HOST: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?|[0-9A-Fa-f:.]+")


@dataclass(frozen=True)
class MachineKeys:
    """Key and certificate of one machine."""

    machine: str
    """Id of the robot, "operator", or "radio"."""
    folder: Path
    hosts: tuple[str, ...]
    """Names and addresses for which its certificate is valid; () for the operator."""
    listens_unnamed: bool
    """True if it listens at all its addresses, but its certificate is valid for its id and id.local only."""


@dataclass(frozen=True)
class FleetKeys:
    """Keys and certificates of a fleet."""

    home: Path
    """Folder of the certificate authority."""
    valid_until: datetime
    machines: tuple[MachineKeys, ...]


def parse_hosts(words: Sequence[str], fleet: Fleet) -> dict[str, list[str]]:
    """Parse options `--host r2=192.168.1.12` into hosts by robot. Raises OptionError."""
    found: dict[str, list[str]] = {}
    for word in words:
        robot, equals, host = word.partition("=")
        if not equals or not _HOST.fullmatch(host):
            raise wrong_value("--host", word, "a robot's id and its name or address, such as r2=192.168.1.12")
        fleet.robot_named(robot)
        found.setdefault(robot, []).append(host)
    return found


def create_keys(
    fleet: Fleet, out: Path, hosts: Mapping[str, Sequence[str]], *, now: datetime, days: int
) -> FleetKeys:
    """Create the authority and the keys of all machines in the new folder `out`, atomically.

    `hosts`: further names and addresses of robots. `days`: validity of the certificates. Private keys are
    readable by their owner only. Raises AcrcError if the folder exists or cannot be created, and OptionError
    for invalid `days`.
    """
    if not 0 < days <= MAX_DAYS:
        raise wrong_value("--days", days, f"a whole number from 1 to {MAX_DAYS}")
    if out.exists():
        raise AcrcError(
            f"{out}: already exists; move it away to create new keys for the whole fleet, or choose another "
            "folder with --out"
        )
    fleet_keys = _describe_keys(fleet, out, hosts, now, days)
    issuer = certificates.create_authority(f"fleet {fleet.path.stem}", now, days)
    with _new_folder(out) as draft:
        certificates.PemKeys(issuer.certificate_pem, b"", issuer.private_pem).write(draft / AUTHORITY_FOLDER)
        packet_key = secrets.token_hex(16)
        for machine in fleet_keys.machines:
            is_robot = machine.machine not in {OPERATOR, RADIO_STATION}
            purposes = [certificates.CLIENT if machine.machine == OPERATOR else certificates.SERVER]
            if is_robot and fleet.radio.network is not None:
                purposes.append(certificates.CLIENT)
            machine_key = certificates.issue_certificate(
                issuer, machine.machine, purposes, machine.hosts, now, days
            )
            certificates.pem_keys(issuer, machine_key).write(draft / machine.machine)
            if is_robot:
                write_secret(draft / machine.machine / PACKET_KEY_FILE, packet_key)
        (draft / ".gitignore").write_text("# Never commit private keys.\n*\n")
    return fleet_keys


def replace_keys(
    fleet: Fleet,
    out: Path,
    revoked: Sequence[str],
    hosts: Mapping[str, Sequence[str]],
    *,
    now: datetime,
    days: int,
) -> tuple[FleetKeys, Path]:
    """Replace all keys in `out`, with a new authority; return them and the folder of the old keys.

    Machines with new keys reject the keys of the machines `revoked` (Zenoh has no revocation lists). The new
    certificates are valid for the same hosts as the old ones. Raises AcrcError if there are no old keys, else
    as `create_keys`.
    """
    for machine in revoked:
        if machine not in {OPERATOR, RADIO_STATION}:
            fleet.robot_named(machine)
    if not (out / AUTHORITY_FOLDER / AUTHORITY_FILE).is_file():
        raise AcrcError(f"{out}: no keys to revoke; run `acrc fleet keys` without --revoke first")
    hosts_by_robot = {
        robot.id: (*_certified_hosts(out / robot.id), *hosts.get(robot.id, ())) for robot in fleet.robots
    }
    old_folder = out.with_name(f"{out.name}.until-{now:%Y%m%d-%H%M%S}")
    if old_folder.exists():
        raise AcrcError(f"{old_folder}: already exists; move it away, the old keys are stored there")
    draft = out.with_name(f"{out.name}.new-{now:%Y%m%d-%H%M%S}")
    create_keys(fleet, draft, hosts_by_robot, now=now, days=days)
    try:
        out.rename(old_folder)
        draft.rename(out)
    except OSError as error:
        raise AcrcError(f"{out}: cannot be replaced by the new keys in {draft}: {error.strerror}") from None
    return _describe_keys(fleet, out, hosts_by_robot, now, days), old_folder


def _certified_hosts(folder: Path) -> tuple[str, ...]:
    """Return the hosts of a machine's certificate; () without certificate."""
    try:
        return certificates.host_names(
            certificates.load_certificate((folder / CERTIFICATE_FILE).read_bytes())
        )
    except (OSError, ValueError):
        return ()


def _describe_keys(
    fleet: Fleet, out: Path, hosts: Mapping[str, Sequence[str]], now: datetime, days: int
) -> FleetKeys:
    machines = [_robot_keys(robot, out, hosts.get(robot.id, ())) for robot in fleet.robots]
    if fleet.radio.network is not None:
        host, _ = host_and_port(fleet.radio.network)
        machines.append(MachineKeys(RADIO_STATION, out / RADIO_STATION, (host,), listens_unnamed=False))
    return FleetKeys(
        home=out / AUTHORITY_FOLDER,
        valid_until=now + timedelta(days=days),
        machines=(*machines, MachineKeys(OPERATOR, out / OPERATOR, (), listens_unnamed=False)),
    )


def _robot_keys(robot: FleetRobot, out: Path, hosts: Sequence[str]) -> MachineKeys:
    """Describe a robot's keys, valid for its id, id.local (mDNS), the host in `listen`, and `hosts`."""
    names = [robot.id, f"{robot.id}.local"]
    if robot.listen_host is not None and not robot.listens_everywhere:
        names.append(robot.listen_host)
    all_hosts = tuple(dict.fromkeys([*names, *hosts]))
    reachable = set(all_hosts) - {robot.id, f"{robot.id}.local"}
    return MachineKeys(robot.id, out / robot.id, all_hosts, robot.listens_everywhere and not reachable)


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """Yield a temporary folder that is renamed to `out` on success and removed on failure."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    except OSError as error:
        raise AcrcError(f"{out}: the folder cannot be created: {error.strerror}") from None
    try:
        yield draft
        draft.rename(out)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
