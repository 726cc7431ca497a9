"""Archive with a robot's program, wheels and configuration, for installation without a network."""

import hashlib
import io
import os
import stat
import subprocess
import sys
import tarfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import PACKAGES
from actors.installation.usage import OptionError, wrong_value
from actors.installation.version import COMMIT, MINORS, requirements, software_version
from actors.processes.launcher import scratch_folder
from actors.robot.behaviour.code_permit import Permit
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError, printable
from actors.runtime.isolation.credentials import PACKET_KEY_FILE, PRIVATE_KEY_FILE
from actors.runtime.isolation.tls import AUTHORITY_FILE, CERTIFICATE_FILE
from actors.settings import read_text, toml_tables
from actors.task.loading import task_entry
from actors.user_code import FINDER
from deploy.fleet import doctor
from deploy.fleet.fleet_file import Fleet, FleetRobot, task_folders, user_code_folders
from deploy.scenario.scenario_file import map_files, strategy_files

MACHINES: Final = {"x86-64": "x86_64", "aarch64": "aarch64"}
"""Processors with pinned wheels, as `uname -m` names them."""
_PLATFORMS: Final = ("manylinux2014", "manylinux_2_17", "manylinux_2_26", "manylinux_2_27", "manylinux_2_28")
_TIMEOUT_S: Final = 900.0
_ROOT_FILES: Final = (
    "LICENSE", "README.md", "acrc", "constraints.txt", "pyproject.toml",
    "distributions/deeco/README.md", "distributions/deeco/pyproject.toml",
)  # fmt: skip
_LINKS: Final = ("distributions/deeco/LICENSE", "distributions/deeco/deeco")
"""Links of the distribution to the sources beside it."""
_EXCLUDED_FOLDERS: Final = ("acrc_testbed/benchmarks", "acrc_testbed/experiments")
CONFIGURATION: Final = "fleets"
"""Folder of the bundle; hidden from the strategy by the robot's sandbox."""
_Files = dict[str, tuple[bytes, int]]
"""Content and mode by path within the bundle; the content of a link is its target."""


class RobotBundle(NamedTuple):
    """A written bundle."""

    file: Path
    robot: str
    machine: str
    python: str
    fleet: str
    """Path of the fleet file within the bundle."""
    own_code: bool
    """True if the bundle contains a user strategy."""
    files: int
    bytes: int
    sha256: str
    lacks: str
    """Packages of `acrc add` that are missing from the bundle; empty for a shipped strategy."""


def write_bundle(
    root: Path, fleet: Fleet, name: str, permit: Permit, *, machine: str, python: str, out: Path
) -> RobotBundle:
    """Write the bundle of the robot `name` from the clone in `root`; equal inputs give equal bytes.

    Raises OptionError, and AcrcError also for faults that `acrc fleet doctor` reports; then writes nothing.
    """
    if machine not in MACHINES:
        raise wrong_value("--machine", machine, " or ".join(MACHINES))
    if python not in (known := [f"3.{minor}" for minor in MINORS]):
        raise wrong_value("--python", python, f"one of {', '.join(known)}")
    if out.is_dir():
        raise OptionError(f"--out: {out} is a directory; give a file")
    robot = fleet.robot_named(name)
    for found in list(doctor.check_configuration(fleet, robot, permit)):
        if not found.ok:
            raise AcrcError(f"{found.subject}: {found.text}")
    code, (configuration, path) = _strategy_files(fleet, permit), _configuration(fleet, robot)
    files = {**_program(root), **code, **configuration}
    files[COMMIT] = (f"{software_version()}\n".encode(), 0o644)
    files |= _wheels((root / "constraints.txt").read_text(), robot.extras, machine, python)
    try:
        _write(out, f"acrc-{name}", files)
    except OSError as error:
        raise AcrcError(f"{out}: the bundle cannot be written: {error.strerror}") from None
    content, added = out.read_bytes(), root / "requirements.txt"
    lacks = ", ".join(added.read_text().split()) if code and added.is_file() else ""
    digest = hashlib.sha256(content).hexdigest()
    return RobotBundle(
        out, name, machine, python, fleet=path, own_code=bool(code), files=len(files), bytes=len(content),
        sha256=digest, lacks=lacks,
    )  # fmt: skip


def _program(root: Path) -> _Files:
    """Return the tracked files that a robot runs, with uncommitted changes."""
    patterns = (*_ROOT_FILES, *sorted(PACKAGES), *(f":(exclude){folder}" for folder in _EXCLUDED_FOLDERS))
    listed = _run("git", "-C", str(root), "ls-files", "-z", "--", *patterns).decode()
    paths = [root / name for name in listed.split("\0") if name]
    links = {name: (bytes((root / name).readlink()), stat.S_IFLNK | 0o777) for name in _LINKS}
    return links | {
        str(path.relative_to(root)): (path.read_bytes(), 0o755 if os.access(path, os.X_OK) else 0o644)
        for path in paths if path.is_file() and not path.is_symlink()
    }  # fmt: skip


def _configuration(fleet: Fleet, robot: FleetRobot) -> tuple[_Files, str]:
    """Return fleet file, map, models and keys, relative paths unchanged, and the fleet file's path."""
    tables = toml_tables(read_text(fleet.path, "fleet"), fleet.path)

    def local(named: str) -> Path:
        if Path(named).is_absolute():
            raise AcrcError(f"{fleet.path}: {named} is an absolute path; make it relative to the fleet file")
        return Path(os.path.normpath(fleet.path.parent / named))

    paths = {Path(os.path.normpath(path)) for path in (fleet.path, *map_files(local(tables["map"])))}
    paths |= {local(one["model"]) for one in tables["robot"] if one.get("model", "").endswith(".toml")}
    private = set[Path]()
    needed = [AUTHORITY_FILE, CERTIFICATE_FILE, PRIVATE_KEY_FILE] if robot.needs_keys else []
    needed += [PACKET_KEY_FILE] if fleet.radio.authenticated else []
    if needed:
        keys = local(tables.get("keys", Path(fleet.keys).name)) / robot.id
        private = {keys / name for name in needed}
    top = os.path.commonpath([path.parent for path in paths | private])
    names = {path: f"{CONFIGURATION}/{path.relative_to(top)}" for path in paths | private}
    configuration = {
        name: (regular_file.read_bytes(path), 0o600 if path in private else 0o644)
        for path, name in names.items()
    }
    return configuration, names[Path(os.path.normpath(fleet.path))]


def _strategy_files(fleet: Fleet, permit: Permit) -> _Files:
    """Return the user's strategy and task, and all modules imported during the check, in `modules/`."""
    folders = {*user_code_folders(fleet, permit), *task_folders(fleet, permit)}
    if len(folders) > 1:
        both = " and ".join(sorted(map(str, folders)))
        raise AcrcError(f"{fleet.path}: strategies and task are in {both}; a bundle needs them in one folder")
    loaded = tuple(FINDER.hashes())
    return {
        f"modules/{path.relative_to(folder)}": (regular_file.read_bytes(path), 0o644)
        for folder in folders
        for used in (fleet.run.strategy, task_entry(fleet.task.use))
        for path in {*strategy_files(used, folder), *(folder / name for name in loaded)}
    }


def _wheels(constraints: str, extras: Sequence[str], machine: str, python: str) -> _Files:
    """Download the pinned wheels of a robot, in `wheels/`. Raises AcrcError."""
    pinned = requirements(constraints, int(python.removeprefix("3.")), (*extras, "build"))
    with scratch_folder() as folder:
        download(folder, pinned, machine, python)
        files = {f"wheels/{path.name}": (path.read_bytes(), 0o644) for path in folder.glob("*.whl")}
    return {**files, "wheels/computer": (f"{MACHINES[machine]} {python}\n".encode(), 0o644)}


def download(path: Path, pinned: Sequence[str], machine: str, python: str) -> None:
    """Download wheels for another computer with the local pip configuration. Raises AcrcError."""
    names = [f"{one}_{MACHINES[machine]}" for one in _PLATFORMS]
    platforms = [word for name in (*names, "any") for word in ("--platform", name)]
    with scratch_folder() as folder:
        listed, pip = folder / "requirements.txt", folder / "pip"
        listed.write_text("".join(f"{line}\n" for line in pinned))
        try:
            _run(sys.executable, "-P", "-m", "venv", str(pip))
            _run(
                str(pip / "bin" / "python"), "-P", "-m", "pip", "--disable-pip-version-check", "-q",
                "download", "--only-binary", ":all:", "--no-deps", "--require-hashes",
                "--python-version", python, *platforms, "-r", str(listed), "-d", str(path),
            )  # fmt: skip
        except AcrcError as error:
            raise AcrcError(
                f"wheels for {machine} and Python {python} cannot be downloaded: {error}; connect to a "
                "network, or set PIP_FIND_LINKS to a folder that contains them"
            ) from None


def _run(*command: str) -> bytes:
    """Run a program and return its standard output. Raises AcrcError with its last error line."""
    try:
        completed = subprocess.run(command, capture_output=True, check=False, timeout=_TIMEOUT_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise AcrcError(f"{command[0]}: {type(error).__name__}") from None
    if completed.returncode:
        lines = completed.stderr.decode(errors="replace").strip().splitlines() or ["no output"]
        errors = [line.strip() for line in lines if "ERROR:" in line] or lines
        raise AcrcError(printable(errors[-1].removeprefix("ERROR: ")))
    return completed.stdout


def _write(path: Path, top: str, files: _Files) -> None:
    """Write a tar archive atomically, readable by its owner only. Raises OSError."""
    with regular_file.atomic_replacement(path) as new:
        new.chmod(0o600)
        with tarfile.open(new, "w", format=tarfile.GNU_FORMAT) as archive:
            for name, (content, mode) in sorted(files.items()):
                entry = tarfile.TarInfo(f"{top}/{name}")
                entry.size, entry.mode = len(content), stat.S_IMODE(mode)
                if stat.S_ISLNK(mode):
                    entry.type, entry.linkname, entry.size = tarfile.SYMTYPE, content.decode(), 0
                entry.mtime = 946_684_800  # 2000-01-01: zip files cannot store dates before 1980
                archive.addfile(entry, io.BytesIO(content))
