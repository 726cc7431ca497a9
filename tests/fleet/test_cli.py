"""The commands as a person meets them."""

import json
import re
import stat
from pathlib import Path

import pytest

from actors.runtime.access.tls import load_keys
from tests.cli.test_cli import acrc
from tests.fleet.texts import OFFICE, ROOT

UNNAMED = (
    "acrc: {0} listens at all its addresses, but its certificate holds for names only; to reach it by an "
    "address, give that: --host {0}=192.168.1.12\n"
)


@pytest.fixture
def office(tmp_path: Path) -> Path:
    """The shipped fleet file, where keys may be made beside it."""
    text = OFFICE.read_text().replace("../maps", str(ROOT / "maps"))
    file = tmp_path / "office.toml"
    file.write_text(text)
    return file


def test_keys_are_made_beside_the_fleet_file_and_each_has_a_goal(office: Path) -> None:
    code, out, err = acrc("fleet", "keys", str(office), "--host", "r1=10.0.0.1", "--host", "r2=10.0.0.2")
    assert code == 0
    assert err == UNNAMED.format("r3")
    keys = office.parent / "office-keys"
    lines = out.splitlines()
    assert lines[:4] == [
        f"{keys}/authority",
        "  stays with you, and off the robots: whoever has it can make keys of this fleet, "
        "for its key is not encrypted",
        f"{keys}/r1",
        f"  to r1:{keys}/r1; holds for r1, r1.local, 10.0.0.1",
    ]
    assert lines[8:10] == [
        f"{keys}/operator",
        "  to the laptop of whoever watches and stops the robots",
    ]
    assert lines[10].startswith("All hold until 20")
    for machine in ("r1", "r2", "r3", "operator"):
        assert stat.S_IMODE(load_keys(keys / machine).private_key.stat().st_mode) == 0o600


def test_revoking_replaces_all_keys_and_says_what_is_to_be_done(office: Path) -> None:
    assert acrc("fleet", "keys", str(office), "--host", "r1=10.0.0.1", "--host", "r3=10.0.0.3")[0] == 0
    code, out, err = acrc("fleet", "keys", str(office), "--revoke", "r2", "--revoke", "operator")
    assert (code, err) == (0, UNNAMED.format("r2"))
    keys = office.parent / "office-keys"
    (aside,) = office.parent.glob("office-keys.until-*")
    assert out.splitlines()[3] == f"  to r1:{keys}/r1; holds for r1, r1.local, 10.0.0.1"
    assert out.splitlines()[-2:] == [
        "What r2, operator had is worth nothing to a machine that has its new folder: copy them all, the "
        "operator's first, and start the robots again.",
        f"The old keys are in {aside}; delete them after that.",
    ]


def test_units_are_written_and_installed_by_nobody_but_you(office: Path, tmp_path: Path) -> None:
    out = tmp_path / "units"
    code, said, err = acrc("fleet", "units", str(office), "--robot", "r2", "--out", str(out), "--user", "me")
    assert code == 0
    assert all("plugged in, so nothing gets this name" in line for line in err.splitlines())
    assert sorted(path.name for path in out.iterdir()) == ["60-acrc.rules", "acrc-r2.service"]
    service = (out / "acrc-r2.service").read_text()
    assert f"\nExecStart={ROOT}/acrc fleet onboard {office} --robot r2\n" in service
    assert "\nUser=me\n" in service
    assert f"  sudo install -m 644 {out}/60-acrc.rules /etc/udev/rules.d/\n" in said
    assert "  sudo systemctl enable --now acrc-r2.service\n" in said


def test_the_doctor_finds_what_is_wrong_and_says_so_by_its_exit_code(office: Path) -> None:
    code, out, err = acrc("fleet", "doctor", str(office), "--robot", "r2")
    assert (code, err) == (1, "")
    assert re.search(r"(?m)^wrong  base +/dev/kobuki: there is no such port, and no Kobuki is seen; ", out)
    code, out, _ = acrc("fleet", "doctor", str(office), "--robot", "r2", "--json")
    report = json.loads(out)
    assert (code, report["robot"], report["ok"]) == (1, "r2", False)
    assert {"subject", "ok", "text"} == set(report["findings"][0])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("keys", "{}", "--days", "0"), "--days: 0; must be a whole number from 1 to 3650"),
        (("keys", "{}", "--revoke", "r9"), '{}: there is no robot "r9" in the fleet; it has r1, r2, r3'),
        (("units", "{}", "--robot", "r9"), '{}: there is no robot "r9" in the fleet; it has r1, r2, r3'),
        (
            ("doctor", "{}"),
            "--robot: is missing; must say which of the robots this computer is: r1, r2, r3",
        ),
        (
            ("doctor", "--robot", "r2"),
            "--robot: r2 without a fleet file; must be as in acrc fleet doctor fleet.toml --robot r2",
        ),
    ],
)
def test_a_wrong_command_line_is_one_sentence(words: tuple[str, ...], sentence: str, office: Path) -> None:
    code, out, err = acrc("fleet", *(word.format(office) for word in words))
    assert (code, out, err) == (2, "", f"acrc: {sentence.format(office)}\n")
