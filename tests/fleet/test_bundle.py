"""A robot's bundle: its contents, its refusals, and a robot that is installed from one without a network."""

import json
import os
import platform
import shutil
import stat
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from actors.installation import pins, version
from actors.robot.behaviour.foreign import INSTALLED, Permit
from actors.runtime.errors import AcrcError
from deploy.fleet import bundle, keys
from deploy.fleet.bundle import RobotBundle
from deploy.fleet.fleet_file import load_fleet
from observation.replay import record_replay
from tests.fleet.texts import OFFICE, ROOT
from tests.in_process import acrc
from tests.onboard.standstill_rig import MAP, Rig

OWN = "from cleaning.strategies.none import behaviour\nimport helper\n"
WHEELS = {"wheels/tiny-1.0-py3-none-any.whl": (b"a wheel", 0o644)}


class SmallClone:
    """A git repository of a few files, and a fleet with keys."""

    def __init__(self, folder: Path) -> None:
        self.root, self.office = folder / "clone", folder / "office.toml"
        for name in bundle._PACKAGES:
            (self.root / name).mkdir(parents=True)
            (self.root / name / "py.typed").touch()
        for name in bundle._ROOT:
            shutil.copy(ROOT / name, self.root)
        (self.root / "actors" / "core.py").touch()
        (self.root / "actors" / "link.py").symlink_to("../acrc")
        for words in (("init", "-q"), ("add", ".")):
            subprocess.run(["git", *words], cwd=self.root, check=True)
        (self.root / "runs.py").touch()
        self.office.write_text(OFFICE.read_text().replace("../maps", "maps"))
        shutil.copytree(ROOT / "maps", folder / "maps")
        fleet = load_fleet(self.office)
        keys.issue(fleet, fleet.keys, {}, now=datetime.now(UTC), days=1)

    def bundle(self, out: Path, permit: Permit | None = None) -> RobotBundle:
        fleet, permit = load_fleet(self.office), permit or Permit()
        return bundle.make(self.root, fleet, "r2", permit, machine="aarch64", python="3.12", out=out)


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SmallClone:
    monkeypatch.setattr(bundle, "_wheels", lambda *_: WHEELS)
    return SmallClone(tmp_path)


def members(file: Path) -> dict[str, tarfile.TarInfo]:
    with tarfile.open(file) as archive:
        return {one.name.removeprefix("acrc-r2/"): one for one in archive}


def content(file: Path, name: str) -> str:
    with tarfile.open(file) as archive:
        found = archive.extractfile(f"acrc-r2/{name}")
        assert found is not None
        return found.read().decode()


def test_it_holds_program_wheels_and_configuration_with_keys_for_its_owner_only(clone: SmallClone) -> None:
    out = clone.root.parent / "b.tar"
    (clone.root / "actors" / "core.py").write_text("pass\n")
    made = clone.bundle(out)
    inside = members(out)
    private = {f"fleets/office-keys/r2/{name}.pem" for name in ("authority", "certificate", "key")}
    configuration = {"fleets/office.toml", "fleets/maps/corridor.yaml", "fleets/maps/corridor.png"}
    packages = {f"{name}/py.typed" for name in bundle._PACKAGES}
    assert inside.keys() == {
        *bundle._ROOT,
        *packages,
        *private,
        *configuration,
        *WHEELS,
        "COMMIT",
        "actors/core.py",
    }
    assert content(out, "actors/core.py") == "pass\n", "changes of tracked files are in it"
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
    """Unload modules whose names other tests use as well."""
    yield
    for name in ("mine", "helper"):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("forgotten")
def test_a_strategy_of_the_user_comes_with_what_it_loads(clone: SmallClone, tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.mkdir()
    for name, text in (("mine.py", OWN), ("helper.py", ""), ("other.py", "raise ValueError")):
        (own / name).write_text(text)
    text = clone.office.read_text().replace('strategy = "chapter"', 'strategy = "mine:behaviour"')
    for given, left in (("adoption_distance", "# "), ("listen =", "# listen =")):
        text = text.replace(given, left)
    clone.office.write_text(text)
    (clone.root / "requirements.txt").write_text("pandas\nnetworkx\n")
    made = clone.bundle(tmp_path / "b.tar", Permit((own,)))
    assert (made.lacks, made.own_code) == ("pandas, networkx", True)
    names = members(tmp_path / "b.tar")
    assert [name for name in names if name.startswith("modules/")] == ["modules/helper.py", "modules/mine.py"]
    assert not any("office-keys" in name for name in names), "a robot that does not listen needs no keys"


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--robot", "r9"), 2, '{office}: there is no robot "r9" in the fleet; it has r1, r2, r3'),
        (("--machine", "mips"), 2, "--machine: mips; must be x86-64 or aarch64"),
        (("--python", "3.10"), 2, "--python: 3.10; must be one of 3.11, 3.12, 3.13, 3.14"),
        (("--out", "."), 2, "--out: . is a folder; must be a file"),
    ],
)
def test_wrong_options_are_one_line(
    options: tuple[str, ...], code: int, said: str, clone: SmallClone
) -> None:
    out = clone.root.parent / "b.tar"
    done = acrc("fleet", "bundle", clone.office, "--robot", "r2", "--out", out, *options)
    assert (done.returncode, done.stderr) == (code, f"acrc: {said.format(office=clone.office)}\n")
    assert not out.exists()


def test_a_path_that_only_this_computer_knows_is_refused(clone: SmallClone) -> None:
    there = f"{clone.office.parent}/maps/corridor.yaml"
    clone.office.write_text(clone.office.read_text().replace('"maps/corridor.yaml"', f'"{there}"'))
    with pytest.raises(AcrcError) as caught:
        clone.bundle(clone.root.parent / "b.tar")
    assert str(caught.value) == (
        f"{clone.office}: names {there}; must be relative to the fleet file, so that the robot finds it"
    )


def test_what_the_doctor_would_report_on_the_robot_is_refused(clone: SmallClone) -> None:
    text = clone.office.read_text()
    clone.office.write_text(text.replace("start = [17.5, 5.0, 0.0]", "start = [0.0, 0.0, 0.0]"))
    with pytest.raises(AcrcError, match=r"^start: robot 'r2' at \(0\.00, 0\.00\) is not on free floor"):
        clone.bundle(clone.root.parent / "b.tar")
    clone.office.write_text(text)
    (clone.office.with_name("office-keys") / "r2" / "authority.pem").unlink()
    with pytest.raises(AcrcError, match=r"^keys: .*authority\.pem cannot be read"):
        clone.bundle(clone.root.parent / "b.tar")
    assert not (clone.root.parent / "b.tar").exists()


def test_wheels_that_pip_does_not_find_are_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in {"CONFIG_FILE": "/dev/null", "NO_INDEX": "1", "FIND_LINKS": str(tmp_path)}.items():
        monkeypatch.setenv(f"PIP_{name}", value)
    with pytest.raises(AcrcError) as caught:
        bundle._wheels(
            f"# [base]\ntiny==1.0 --hash=sha256:{'0' * 64}\n# [hardware]\n# [build]\n", "x86-64", "3.13"
        )
    assert str(caught.value) == (
        "wheels for x86-64 and Python 3.13 cannot be fetched: No matching distribution found for tiny==1.0; "
        "connect to a network, or set PIP_FIND_LINKS to a folder that has them"
    )


def test_a_bundles_program_knows_its_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / version.COMMIT).write_text("abc+\n")
    monkeypatch.setattr(version, "REPOSITORY", tmp_path)
    assert version.software() == "abc+"


@pytest.mark.parametrize("minor", pins.MINORS)
def test_every_pin_of_a_robot_is_read_with_its_hashes(minor: int) -> None:
    text = (ROOT / "constraints.txt").read_text()
    found = pins.sections(text, minor)
    names = [pin.name for section in ("build", "base", "hardware") for pin in found[section]]
    assert len(names) == len(set(names)) and {"numba", "setuptools", "pyserial", "cryptography"} <= set(names)
    assert all(pin.hashes for section in found.values() for pin in section)
    listed = pins.requirements(text, minor, ("build", "base", "hardware"))
    assert len(listed) == len(names) and json.dumps(listed).count("; python") == 0


class BundledRig(Rig):
    """Emulated devices here; the robot runs from its bundle, in a network namespace without interfaces."""

    def onboard(self) -> list[str]:
        words = (self.folder / "acrc-r1" / "acrc", "fleet", "onboard", "fleets/fleet.toml")
        place = ("env", "-C", str(self.folder / "acrc-r1"), "unshare", "--map-root-user", "--net")
        return [*place, *map(str, words), "--robot", "r1", "--out", str(self.out)]


@pytest.mark.claim("bundle")
@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_a_robot_is_installed_and_drives_without_a_network(tmp_path: Path, full: bool) -> None:
    """Needs a network, or PIP_FIND_LINKS, to fetch the wheels; the installation has neither."""
    rig = BundledRig(tmp_path)
    for file in (MAP, MAP.with_suffix(".png")):
        shutil.copy(file, tmp_path)
    machine = {"x86_64": "x86-64"}.get(platform.machine(), platform.machine())
    fleet, out = load_fleet(rig.write_fleet(MAP.name)), tmp_path / "r1.tar"
    python = f"3.{sys.version_info.minor}"
    bundle.make(ROOT, fleet, "r1", INSTALLED, machine=machine, python=python, out=out)
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
