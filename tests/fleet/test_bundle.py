"""A robot's bundle: what is in it, who may read it, and why none is made."""

import hashlib
import json
import stat
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from actors.installation import pins, version
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError
from deploy.fleet.bundle import making
from deploy.fleet.fleet_file import load_fleet
from tests.cli.test_cli import acrc
from tests.fleet.small_bundle import NATIVE, PURE, SmallClone, copied, without_network
from tests.fleet.texts import ROOT
from tests.fleet.unit_file import read_unit, words

OWN = """
from cleaning.strategies.none import behaviour
import helper
"""


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SmallClone:
    small = SmallClone(tmp_path)
    monkeypatch.setattr(making, "fetch", copied(small.wheels))
    return small


def members(file: Path) -> dict[str, tarfile.TarInfo]:
    with tarfile.open(file) as archive:
        return {one.name.removeprefix("acrc-r2/"): one for one in archive}


def content(file: Path, name: str) -> str:
    with tarfile.open(file) as archive:
        found = archive.extractfile(f"acrc-r2/{name}")
        assert found is not None
        return found.read().decode()


@pytest.mark.parametrize("machine", ["aarch64", "x86_64"])
def test_it_holds_what_a_robot_needs_for_its_processor_and_nothing_else(
    machine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = SmallClone(tmp_path)
    small.issue()
    without_network(monkeypatch, small.wheels)
    out = tmp_path / "b.tar"
    made = small.bundle(out, machine=machine.replace("_", "-"))
    inside = members(out)
    keys = {f"files/office-keys/r2/{name}.pem" for name in ("authority", "certificate", "key")}
    told = {*keys, "files/office.toml", "files/maps/corridor.yaml", "files/maps/corridor.png", "fleet.toml"}
    program = {
        *("LICENSE", "README.md", "acrc", "constraints.txt", "pyproject.toml", "COMMIT", "about", ".state"),
        *("actors/core.py", "actors/py.typed", "units/acrc-r2.service", *(f"fleets/{one}" for one in told)),
    }
    wheels = {f"wheels/{PURE}", f"wheels/{NATIVE[machine]}"}
    assert set(inside) == {"SHA256SUMS", "install.sh", *wheels, *(f"program/{one}" for one in program)}
    links = {name: one.linkname for name, one in inside.items() if one.issym()}
    assert links == {
        "program/.state": "/var/lib/acrc/state",
        "program/fleets/fleet.toml": "files/office.toml",
    }
    assert content(out, "program/about") == f"robot r2\nmachine {machine}\npython 3.12\n"
    assert content(out, "program/fleets/files/office.toml") == small.office.read_text()
    size, digest = out.stat().st_size, hashlib.sha256(out.read_bytes()).hexdigest()
    assert (made.bytes, made.files, made.sha256) == (size, len(inside) - 3, digest)


def test_keys_and_archive_are_its_owners_alone_and_nothing_tells_of_who_made_it(clone: SmallClone) -> None:
    clone.issue()
    out = clone.root.parent / "b.tar"
    clone.bundle(out)
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    modes = {name: one.mode for name, one in members(out).items() if not one.issym()}
    private = [name for name, mode in modes.items() if mode == 0o600]
    assert private and all("office-keys/r2/" in name for name in private)
    assert [name for name, mode in modes.items() if mode == 0o755] == ["install.sh", "program/acrc"]
    assert {*modes.values()} == {0o600, 0o644, 0o755}
    assert {(one.uid, one.gid, one.uname, one.mtime) for one in members(out).values()} == {
        (0, 0, "", 946_684_800)
    }


def test_the_same_inputs_give_the_same_bytes_and_others_do_not(clone: SmallClone) -> None:
    clone.issue()
    folder = clone.root.parent
    first, second = clone.bundle(folder / "a.tar"), clone.bundle(folder / "b.tar")
    assert first.sha256 == second.sha256 and first.lacks == ""
    (clone.root / "actors" / "core.py").write_text("pass\n")
    assert clone.bundle(folder / "c.tar").sha256 != first.sha256


def test_every_file_has_its_sum_as_sha256sum_reads_it(clone: SmallClone) -> None:
    clone.issue()
    folder = clone.root.parent
    clone.bundle(folder / "b.tar")
    subprocess.run(["tar", "-xf", folder / "b.tar", "-C", folder], check=True)
    home = folder / "acrc-r2"
    said = subprocess.run(
        ["sha256sum", "-c", "SHA256SUMS"], cwd=home, capture_output=True, text=True, check=True
    )
    files = {str(one.relative_to(home)) for one in home.rglob("*") if one.is_file() and not one.is_symlink()}
    assert {line.removesuffix(": OK") for line in said.stdout.splitlines()} == files - {"SHA256SUMS"}


def test_its_service_is_that_of_fleet_units_where_the_installer_puts_it(clone: SmallClone) -> None:
    clone.issue()
    out = clone.root.parent / "b.tar"
    clone.bundle(out)
    service = read_unit(content(out, "program/units/acrc-r2.service"))["Service"]
    current = "/srv/acrc/current"
    assert words(service["ExecStart"][0]) == [
        *(f"{current}/acrc", "fleet", "onboard", f"{current}/fleets/fleet.toml", "--robot", "r2")
    ]
    assert (service["User"], service["ReadWritePaths"]) == (["acrc"], [current])
    assert f"{current}/firmware_bridge/kobuki/guardian.py" in words(service["ExecStopPost"][0])


@pytest.fixture
def forgotten() -> Iterator[None]:
    """What is loaded here under names that others use as well is gone afterwards."""
    yield
    for name in ("mine", "helper"):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("forgotten")
def test_a_strategy_of_ones_own_comes_with_what_it_loads(clone: SmallClone, tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.mkdir()
    for name, text in (("mine.py", OWN), ("helper.py", ""), ("other.py", "raise ValueError")):
        (own / name).write_text(text)
    text = clone.office.read_text().replace('strategy = "chapter"', 'strategy = "mine:behaviour"')
    for given, left in (("adoption_distance", "# "), ("listen =", "# listen =")):
        text = text.replace(given, left)
    clone.office.write_text(text)
    out, fleet, permit = tmp_path / "b.tar", load_fleet(clone.office), Permit((own,))
    (clone.root / "requirements.txt").write_text("pandas\nnetworkx\n")
    made = making.make(clone.root, fleet, "r2", permit, machine="x86-64", python="3.12", out=out)
    assert made.lacks == "pandas, networkx"
    code = [name for name in members(out) if name.startswith("program/modules/")]
    assert code == ["program/modules/helper.py", "program/modules/mine.py"]
    start = read_unit(content(out, "program/units/acrc-r2.service"))["Service"]["ExecStart"][0]
    assert words(start)[-2:] == ["--modules", "/srv/acrc/current/modules"]
    assert not any("office-keys" in name for name in members(out)), "who does not listen needs no keys"


def test_a_wheel_that_is_not_there_is_a_sentence_and_no_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = SmallClone(tmp_path)
    small.issue()
    without_network(monkeypatch, small.wheels)
    with pytest.raises(AcrcError) as caught:
        small.bundle(tmp_path / "b.tar", python="3.13")
    assert str(caught.value) == (
        "wheels for x86-64 and Python 3.13 cannot be fetched: No matching distribution found for "
        "native==2.0; connect to a network, or set PIP_FIND_LINKS to a folder that has them"
    )
    assert not (tmp_path / "b.tar").exists()


def test_a_wheel_with_another_hash_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = SmallClone(tmp_path)
    small.issue()
    without_network(monkeypatch, small.wheels)
    with (small.wheels / PURE).open("ab") as file:
        file.write(b"more")
    with pytest.raises(AcrcError, match=r"^wheels for x86-64 and Python 3\.12 cannot be fetched: "):
        small.bundle(tmp_path / "b.tar")
    assert not (tmp_path / "b.tar").exists()


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--robot", "r9"), 2, '{office}: there is no robot "r9" in the fleet; it has r1, r2, r3'),
        (("--machine", "mips"), 2, "--machine: mips; must be x86-64 or aarch64"),
        (("--python", "3.10"), 2, "--python: 3.10; must be one of 3.11, 3.12, 3.13, 3.14"),
        (("--out", "."), 2, "--out: . is a folder; must be a file"),
        (
            (),
            1,
            "keys: {keys}/r2/authority.pem cannot be read (No such file or directory); `acrc fleet keys` "
            "makes the keys of all machines, and this machine needs a copy of its own folder",
        ),
    ],
)
def test_what_cannot_be_bundled_is_one_line(
    options: tuple[str, ...], code: int, said: str, clone: SmallClone
) -> None:
    out = clone.root.parent / "b.tar"
    given = ("--robot", "r2", "--out", str(out), *options)
    office = clone.office
    expected = said.format(office=office, keys=office.with_name("office-keys"))
    assert acrc("fleet", "bundle", str(office), *given) == (code, "", f"acrc: {expected}\n")
    assert not out.exists()


@pytest.mark.parametrize("key", ["map", "keys"])
def test_a_path_that_only_this_computer_knows_is_refused(key: str, clone: SmallClone) -> None:
    folder, text = clone.office.parent, clone.office.read_text()
    clone.issue()
    there = {"map": f"{folder}/maps/corridor.yaml", "keys": f"{folder}/office-keys"}[key]
    kept = [line for line in text.splitlines() if not line.startswith(f"{key} =")]
    clone.office.write_text("\n".join([f'{key} = "{there}"', *kept]))
    with pytest.raises(AcrcError) as caught:
        clone.bundle(folder / "b.tar")
    assert str(caught.value) == (
        f"{clone.office}: names {there}; must be relative to the fleet file, so that the robot finds it"
    )


def test_what_the_doctor_would_find_wrong_on_the_robot_is_found_here(clone: SmallClone) -> None:
    clone.issue()
    clone.office.write_text(
        clone.office.read_text().replace("start = [17.5, 5.0, 0.0]", "start = [0.0, 0.0, 0.0]")
    )
    with pytest.raises(AcrcError, match=r"^start: robot 'r2' at \(0\.00, 0\.00\) is not on free floor"):
        clone.bundle(clone.root.parent / "b.tar")


def test_the_command_says_how_large_it_is_and_what_to_do_with_it(clone: SmallClone) -> None:
    """With the wheels of this project, or, where they cannot be had, why it is not made."""
    clone.issue()
    out = clone.root.parent / "b.tar"
    code, said, err = acrc("fleet", "bundle", str(clone.office), "--robot", "r2", "--out", str(out))
    if code:
        assert (
            err.startswith("acrc: wheels for x86-64 and Python 3.11 cannot be fetched: ") and not out.exists()
        )
        return
    digest = hashlib.sha256(out.read_bytes()).hexdigest()
    assert said.splitlines()[0].startswith(f"{out}: {out.stat().st_size / 1e6:.1f} MB, ")
    assert said.splitlines()[1:] == [
        f"SHA-256 {digest}", "", "Copy it onto the robot's computer, then there:", "",
        "  tar -xf b.tar", "  sudo acrc-r2/install.sh",
    ]  # fmt: skip


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
    assert sum(text.count(f"\n{pin.name}=={pin.version}") for pin in found["base"]) == len(found["base"])
