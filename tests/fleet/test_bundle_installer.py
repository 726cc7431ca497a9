"""A bundle's installer: as root of a namespace, on a computer whose python3 installs nothing."""

import os
import platform
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from deploy.fleet.bundle import making
from tests.fleet.small_bundle import PURE, SmallClone, copied
from tests.fleet.texts import ROOT

TOOLS = (
    *(
        "sh",
        "awk",
        "cat",
        "chmod",
        "cksum",
        "cp",
        "cut",
        "date",
        "dirname",
        "du",
        "grep",
        "id",
        "ln",
        "mkdir",
    ),
    *("mv", "readlink", "rm", "sed", "sha256sum", "sleep", "sort", "tr", "wc", "mount", "unshare"),
)
NOTED = 'echo "${0##*/} $*" >>"$NOTES"'
STAND_INS = {
    "useradd": NOTED,
    "runuser": NOTED,
    "chown": ":",
    "sync": ":",
    "install": 'for folder; do :; done; mkdir "$folder"',
}
ON_ROBOT = """
mount --bind "$1/srv" /srv && mount --bind "$1/lib" /var/lib && mount --bind "$1/etc" /etc &&
mount -t tmpfs none /run && exec "$2"
"""
HERE = {"x86_64": "x86-64", "aarch64": "aarch64"}[platform.machine()]
OTHER = {"x86-64": "aarch64", "aarch64": "x86-64"}[HERE]
PYTHON = f"3.{sys.version_info.minor}"
SERVICE, RULES = "systemd/system/acrc-r2.service", "udev/rules.d/60-acrc.rules"


class Robot:
    """A robot's computer, and the clone that its bundles are made of."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.tools, self.notes = folder, folder / "tools", folder / "notes"
        for name in ("laptop", "srv", "lib", "etc", "tools", "a stick"):
            (folder / name).mkdir()
        self.etc, self.kept = folder / "etc", folder / "lib" / "acrc"
        self.small = SmallClone(folder / "laptop")
        self.small.issue()
        for name in TOOLS:
            found = shutil.which(name)
            assert found is not None
            (self.tools / name).symlink_to(found)
        fake = Path(__file__).with_name("fake_robot.sh").read_text()
        for name, script in {**STAND_INS, "python3": fake}.items():
            (self.tools / name).write_text(script if script.startswith("#!") else f"#!/bin/sh\n{script}\n")
            (self.tools / name).chmod(0o755)

    @property
    def current(self) -> Path:
        """Of the version that a start would take. OSError if there is none."""
        return self.folder / "srv" / "acrc" / (self.folder / "srv" / "acrc" / "current").readlink()

    def unpacked(self, robot: str = "r2", machine: str = HERE, python: str = PYTHON) -> Path:
        """A bundle, made and unpacked below a folder with a blank in its name."""
        out, home = self.folder / "b.tar", self.folder / "a stick" / f"acrc-{robot}"
        self.small.bundle(out, robot, machine, python)
        shutil.rmtree(home, ignore_errors=True)
        subprocess.run(["tar", "-xf", out, "-C", home.parent], check=True)
        return home

    def changed(self) -> Path:
        """Another version of the bundle."""
        (self.small.root / "actors" / "core.py").write_text("pass\n")
        return self.unpacked()

    def begin(self, bundle: Path, **settings: str) -> "subprocess.Popen[str]":
        """Start its installer."""
        given = {
            "PATH": self.tools, "FAKE": self.tools / "python3", "REAL": sys.executable, "NOTES": self.notes,
            "BASE": ROOT / "tests" / "cli" / "fake_python.sh", "VERSION": f"{PYTHON}.1",
        }  # fmt: skip
        words = ("unshare", "--map-root-user", "--mount", "sh", "-c", ON_ROBOT, "sh")
        return subprocess.Popen(
            [self.tools / "unshare", *words[1:], self.folder, bundle / "install.sh"],
            env={**{name: str(value) for name, value in given.items()}, **settings},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip

    def install(self, bundle: Path, **settings: str) -> tuple[int, str]:
        """Exit code and what is said."""
        process = self.begin(bundle, **settings)
        said, _ = process.communicate(timeout=60)
        return process.returncode, said


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    made = Robot(tmp_path)
    monkeypatch.setattr(making, "fetch", copied(made.small.wheels))
    return made


def test_a_first_installation_makes_user_version_service_and_rules_and_starts_nothing(robot: Robot) -> None:
    code, said = robot.install(robot.unpacked())
    assert code == 0, said
    version = robot.current
    assert f"\nacrc: r2 is installed in /srv/acrc/versions/{version.name}, " in said
    assert said.splitlines()[-1] == (
        "acrc: start it, somebody beside it: sudo systemctl enable acrc-r2 && sudo systemctl restart acrc-r2"
    )
    assert (robot.etc / SERVICE).read_bytes() == (version / "units" / "acrc-r2.service").read_bytes()
    assert (robot.etc / RULES).read_text() == "all named\n"
    assert (version / "fleets" / "fleet.toml").read_text() == robot.small.office.read_text()
    assert (version / ".state").readlink() == Path("/var/lib/acrc/state") and (robot.kept / "state").is_dir()
    key = version / "fleets" / "files" / "office-keys" / "r2" / "key.pem"
    assert key.stat().st_mode & 0o777 == 0o600 and not (version / "wheels").exists()
    notes = robot.notes.read_text()
    made = "--system --home-dir /var/lib/acrc --no-create-home --shell /usr/sbin/nologin --groups dialout"
    assert notes.startswith(f"useradd {made} acrc\n") and "systemctl" not in notes
    asked = "/srv/acrc/current/acrc fleet doctor /srv/acrc/current/fleets/fleet.toml --robot r2"
    assert notes.endswith(f"runuser -u acrc -- {asked}\n")


def test_pip_is_told_to_use_what_the_bundle_has_and_no_network(robot: Robot) -> None:
    fake = robot.tools / "python3"
    told = 'echo "told $PIP_NO_INDEX $PIP_CONFIG_FILE $(ls $PIP_FIND_LINKS/)" >>"$NOTES"'
    told = f'[ "$1 $2" != "-m pip" ] || {told}'
    fake.write_text(fake.read_text().replace("#!/bin/sh", f"#!/bin/sh\n{told}"))
    (robot.tools / "ls").symlink_to(str(shutil.which("ls")))
    assert robot.install(robot.unpacked())[0] == 0
    wheels = "\n".join(sorted(one.name for one in robot.small.wheels.iterdir()))
    assert robot.notes.read_text().count(f"told 1 /dev/null {wheels}\n") == 3
    installed = (robot.current / ".venv" / "installed").read_text()
    assert (
        installed.startswith(f"/srv/acrc/versions/{robot.current.name}\n") and "extra hardware" in installed
    )


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        (f"wheels/{PURE}", b"x", "{home}/wheels/" + PURE + ": is damaged or missing; copy the bundle again"),
        ("program/acrc", None, "{home}/program/acrc: is damaged or missing; copy the bundle again"),
        ("SHA256SUMS", b"x", "{home}/SHA256SUMS: is damaged; copy the bundle again"),
        ("SHA256SUMS", None, "{home}/SHA256SUMS: is missing; copy the bundle again"),
    ],
)
def test_a_damaged_bundle_is_refused_by_the_name_of_the_file(
    name: str, damage: bytes | None, said: str, robot: Robot
) -> None:
    home = robot.unpacked()
    content = (home / name).read_bytes()
    (home / name).unlink()
    if damage is not None:
        (home / name).write_bytes(damage + content[1:])
    assert robot.install(home) == (1, f"acrc: {said.format(home=home)}\n")
    assert not any((robot.folder / "srv").iterdir())


@pytest.mark.parametrize(
    ("machine", "python"),
    [(OTHER, PYTHON), (HERE, "3.14" if PYTHON != "3.14" else "3.13")],
    ids=["processor", "python"],
)
def test_another_processor_or_python_is_one_sentence(machine: str, python: str, robot: Robot) -> None:
    code, said = robot.install(robot.unpacked(machine=machine, python=python))
    there = {"x86-64": "x86_64"}.get(machine, machine)
    assert (code, said) == (
        1,
        f"acrc: this computer is {platform.machine()} of 64 bits with Python {PYTHON}, but the bundle is for "
        f"{there} of 64 bits with Python {python}; make one that fits with --machine and --python\n",
    )
    assert not any((robot.folder / "srv").iterdir())


def test_a_computer_is_one_robot_until_somebody_says_otherwise(robot: Robot) -> None:
    assert robot.install(robot.unpacked())[0] == 0
    before = robot.current
    assert robot.install(robot.unpacked("r3")) == (
        1,
        "acrc: this computer is r2, but the bundle is for r3; to make it r3: sudo systemctl disable --now "
        "acrc-r2; sudo rm /srv/acrc/current\n",
    )
    assert robot.current == before


FAULTS = {
    "pip": {"FAKE_PIP_FAILS": "yes"},
    "kernels": {"KERNELS_FAIL": "yes"},
}


@pytest.mark.parametrize("fault", ["pip", "kernels", "killed"])
def test_an_update_that_does_not_end_leaves_the_old_version_and_what_the_robot_keeps(
    fault: str, robot: Robot
) -> None:
    assert robot.install(robot.unpacked())[0] == 0
    old = robot.current
    kept = {
        "state/r2.epochs": "7 x",
        "runs/20260101-000000/r2/r2.mcap": "a recording",
        "runs/r2.pose": "here",
    }
    for name, text in kept.items():
        (robot.kept / name).parent.mkdir(parents=True, exist_ok=True)
        (robot.kept / name).write_text(text)
    before = {path: path.read_bytes() for path in old.rglob("*") if path.is_file() and not path.is_symlink()}
    service = (robot.etc / SERVICE).read_bytes()
    update = robot.changed()
    if fault == "killed":
        process = robot.begin(update, FAKE_PIP_TAKES="30")
        while len(list(robot.folder.glob("srv/acrc/versions/*/.venv"))) < 2:
            assert process.poll() is None
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    else:
        code, said = robot.install(update, **FAULTS[fault])
        assert code == 1 and said.splitlines()[-1].startswith(
            "acrc: the version that was here stays; this one "
        )
    assert robot.current == old and (robot.etc / SERVICE).read_bytes() == service
    assert {path: path.read_bytes() for path in before} == before
    assert robot.install(update)[0] == 0
    new = robot.current
    assert not (new / "program").exists(), "what was there of it was not made anew"
    assert new != old and (new / "actors" / "core.py").read_text() == "pass\n"
    assert {path: path.read_bytes() for path in before} == before, "what runs goes on until it is restarted"
    assert {name: (robot.kept / name).read_text() for name in kept} == kept
    assert (new / ".state").readlink() == (old / ".state").readlink()


def test_to_go_back_the_old_bundle_is_installed_again_without_being_made_again(robot: Robot) -> None:
    first = robot.unpacked()
    assert robot.install(first)[0] == 0
    old, aside = robot.current, robot.folder / "first"
    shutil.copytree(first, aside, symlinks=True)
    assert robot.install(robot.changed())[0] == 0
    pips = robot.notes.read_text().count("pip -m pip")
    code, said = robot.install(aside)
    assert (code, robot.current) == (0, old)
    assert robot.notes.read_text().count("pip -m pip") == pips
    assert "acrc: another version is kept; once nothing runs of it: sudo rm -r /srv/acrc/versions/" in said


def test_names_of_devices_are_not_lost_by_an_update_without_them(robot: Robot) -> None:
    bundle, rules = robot.unpacked(), robot.etc / RULES
    unplugged = "# no RPLIDAR is plugged in, so nothing gets this name"
    assert robot.install(bundle, RULES=unplugged)[0] == 0
    assert rules.read_text() == f"{unplugged}\n"
    assert robot.install(bundle)[0] == 0
    code, said = robot.install(bundle, RULES=unplugged)
    assert (code, rules.read_text()) == (0, "all named\n")
    assert said.splitlines()[0] == (
        "acrc: /etc/udev/rules.d/60-acrc.rules stays as it was: not all devices of the robot are plugged in; "
        "plug them in and install again"
    )
