"""Makes the keys of a fleet: an authority that stays at home, and a folder for every machine to take."""

import os
import re
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
from actors.runtime.isolation.credentials import PRIVATE_KEY_FILE
from actors.runtime.isolation.tls import AUTHORITY_FILE, CERTIFICATE_FILE, OPERATOR
from deploy.fleet.fleet_file import Fleet, FleetRobot
from deploy.hosts import certificates
from deploy.hosts.certificates import CLIENT, SERVER, Pair

HOME: Final = "authority"
"""Folder of the authority, which goes to no machine."""
LONGEST_DAYS: Final = 3650
_HOST: Final = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?|[0-9A-Fa-f:.]+")


@dataclass(frozen=True)
class MachineKeys:
    """What was made for one machine."""

    machine: str
    """Id of the robot, or "operator"."""
    folder: Path
    hosts: tuple[str, ...]
    """Names and addresses that its certificate holds for; none for the operator."""
    listens_unnamed: bool
    """It listens at all its addresses, and none was given: it can be reached by the names in `hosts` only."""


@dataclass(frozen=True)
class FleetKeys:
    """What was made for a fleet."""

    home: Path
    """Folder of the authority."""
    valid_until: datetime
    machines: tuple[MachineKeys, ...]


def hosts_of(words: Sequence[str], fleet: Fleet) -> dict[str, list[str]]:
    """The options `--host r2=192.168.1.12` as hosts by robot. Raises OptionError."""
    found: dict[str, list[str]] = {}
    for word in words:
        robot, equals, host = word.partition("=")
        if not equals or not _HOST.fullmatch(host):
            raise wrong_value("--host", word, "a robot's id and its name or address, such as r2=192.168.1.12")
        fleet.robot_named(robot)
        found.setdefault(robot, []).append(host)
    return found


def issue(
    fleet: Fleet, out: Path, hosts: Mapping[str, Sequence[str]], *, now: datetime, days: int
) -> FleetKeys:
    """Make the authority and everyone's keys in the new folder `out`: all of them, or nothing at all.

    `hosts`: further names and addresses of robots. `days`: how long the certificates hold. Private keys can
    be read by their owner only. Raises AcrcError where the folder is there already or cannot be made, and
    OptionError where `days` makes no sense.
    """
    if not 0 < days <= LONGEST_DAYS:
        raise wrong_value("--days", days, f"a whole number from 1 to {LONGEST_DAYS}")
    if out.exists():
        raise AcrcError(
            f"{out}: exists already; move it away to give the whole fleet new keys, or name another folder "
            "with --out"
        )
    made = _described(fleet, out, hosts, now, days)
    issuer = certificates.authority(f"fleet {fleet.path.stem}", now, days)
    with _new_folder(out) as draft:
        _write(draft / HOME, issuer, issuer)
        for machine in made.machines:
            purpose = CLIENT if machine.machine == OPERATOR else SERVER
            pair = certificates.machine(issuer, machine.machine, [purpose], machine.hosts, now, days)
            _write(draft / machine.machine, issuer, pair)
        (draft / ".gitignore").write_text("# Private keys belong in no repository.\n*\n")
    return made


def renew(
    fleet: Fleet,
    out: Path,
    revoked: Sequence[str],
    hosts: Mapping[str, Sequence[str]],
    *,
    now: datetime,
    days: int,
) -> tuple[FleetKeys, Path]:
    """Make all keys anew, by a new authority, in place of those in `out`; and where the old ones are now.

    Thereby the keys of the machines `revoked` are worth nothing to a machine that has its new folder: Zenoh
    knows no list of revoked certificates. What the old certificates held for the new ones hold for, too.
    Raises AcrcError where there are no old keys, else as `issue`.
    """
    for machine in revoked:
        if machine != OPERATOR:
            fleet.robot_named(machine)
    if not (out / HOME / AUTHORITY_FILE).is_file():
        raise AcrcError(
            f"{out}: there are no keys to revoke; `acrc fleet keys` without --revoke makes the first"
        )
    known = {robot.id: (*_held_for(out / robot.id), *hosts.get(robot.id, ())) for robot in fleet.robots}
    aside = out.with_name(f"{out.name}.until-{now:%Y%m%d-%H%M%S}")
    if aside.exists():
        raise AcrcError(f"{aside}: exists already; the old keys would be put there")
    draft = out.with_name(f"{out.name}.new-{now:%Y%m%d-%H%M%S}")
    issue(fleet, draft, known, now=now, days=days)
    try:
        out.rename(aside)
        draft.rename(out)
    except OSError as error:
        raise AcrcError(
            f"{out}: the new keys are in {draft}, but cannot go there: {error.strerror}"
        ) from None
    return _described(fleet, out, known, now, days), aside


def _held_for(folder: Path) -> tuple[str, ...]:
    """What a machine's certificate holds for; nothing if it has none."""
    try:
        return certificates.hosts(certificates.read((folder / CERTIFICATE_FILE).read_bytes()))
    except (OSError, ValueError):
        return ()


def _described(
    fleet: Fleet, out: Path, hosts: Mapping[str, Sequence[str]], now: datetime, days: int
) -> FleetKeys:
    machines = [_robot(robot, out, hosts.get(robot.id, ())) for robot in fleet.robots]
    return FleetKeys(
        home=out / HOME,
        valid_until=now + timedelta(days=days),
        machines=(*machines, MachineKeys(OPERATOR, out / OPERATOR, (), listens_unnamed=False)),
    )


def _robot(robot: FleetRobot, out: Path, hosts: Sequence[str]) -> MachineKeys:
    """Its own id as a name, also with mDNS's ending, where it listens, and what was given."""
    names = [robot.id, f"{robot.id}.local"]
    if robot.listen_host is not None and not robot.listens_everywhere:
        names.append(robot.listen_host)
    every = tuple(dict.fromkeys([*names, *hosts]))
    reachable = set(every) - {robot.id, f"{robot.id}.local"}
    return MachineKeys(robot.id, out / robot.id, every, robot.listens_everywhere and not reachable)


@contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """A folder to fill, which becomes `out` once it is full, and is gone if that fails."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    except OSError as error:
        raise AcrcError(f"{out}: the folder cannot be made: {error.strerror}") from None
    try:
        yield draft
        draft.rename(out)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _write(folder: Path, issuer: Pair, pair: Pair) -> None:
    folder.mkdir(mode=0o700)
    (folder / AUTHORITY_FILE).write_bytes(issuer.certificate_pem)
    if pair is not issuer:
        (folder / CERTIFICATE_FILE).write_bytes(pair.certificate_pem)
    handle = os.open(folder / PRIVATE_KEY_FILE, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(pair.private_pem)
