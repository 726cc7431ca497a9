"""The fleet's authority and certificates: what is in them, and which files lie where for whose eyes."""

import ipaddress
import shlex
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, EllipticCurvePublicKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.verification import PolicyBuilder, Store

from actors.runtime.access.tls import Keys, load_keys
from actors.runtime.errors import AcrcError
from deploy.fleet.keys import FleetKeys, hosts_of, issue, renew
from deploy.hosts import certificates
from tests.fleet.texts import fleet, robot

NOW = datetime(2030, 5, 1, 12, tzinfo=UTC)
FLEET = fleet(
    robot(1, 'listen = "tls/0.0.0.0:7447"')
    + robot(2, 'listen = "tls/192.168.1.12:7447"')
    + robot(3, 'listen = "tls/r3.office.example:7447"')
    + robot(4)
)


def made(out: Path) -> FleetKeys:
    return issue(FLEET, out, {"r1": ["192.168.1.11", "fd00::11"]}, now=NOW, days=30)


def certificate(folder: Path, name: str = "certificate.pem") -> x509.Certificate:
    return certificates.read((folder / name).read_bytes())


def test_every_machine_gets_a_folder_of_its_own_and_the_authority_stays(tmp_path: Path) -> None:
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
    assert (tmp_path / "keys" / ".gitignore").read_text().endswith("\n*\n")


def test_names_purposes_and_dates_are_in_the_certificates(tmp_path: Path) -> None:
    keys = made(tmp_path / "keys")
    authority = certificate(keys.home, "authority.pem")
    assert certificates.common_name(authority) == "fleet some"
    assert authority.extensions.get_extension_for_class(x509.BasicConstraints).value == x509.BasicConstraints(
        ca=True, path_length=0
    )
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


def test_a_certificate_holds_for_the_robots_names_and_addresses(tmp_path: Path) -> None:
    keys = made(tmp_path / "keys")
    hosts = {one.machine: one.hosts for one in keys.machines}
    assert hosts == {
        "r1": ("r1", "r1.local", "192.168.1.11", "fd00::11"),
        "r2": ("r2", "r2.local", "192.168.1.12"),
        "r3": ("r3", "r3.local", "r3.office.example"),
        "r4": ("r4", "r4.local"),
        "operator": (),
    }
    assert [one.listens_unnamed for one in keys.machines] == [False] * 5
    bare = issue(FLEET, tmp_path / "bare", {}, now=NOW, days=30)
    assert [one.listens_unnamed for one in bare.machines] == [True, False, False, False, False]
    store = Store([certificate(keys.home, "authority.pem")])
    for one in keys.machines[:-1]:
        for host in one.hosts:
            policy = PolicyBuilder().store(store).time(NOW)
            policy.build_server_verifier(certificates.general_name(host)).verify(certificate(one.folder), [])
    address = x509.IPAddress(ipaddress.ip_address("192.168.1.12"))
    with pytest.raises(x509.verification.VerificationError):
        PolicyBuilder().store(store).time(NOW).build_server_verifier(address).verify(
            certificate(tmp_path / "keys" / "r1"), []
        )


def test_keys_are_never_overwritten(tmp_path: Path) -> None:
    keys = made(tmp_path / "keys")
    before = (keys.home / "key.pem").read_bytes()
    with pytest.raises(AcrcError) as caught:
        made(tmp_path / "keys")
    assert str(caught.value) == (
        f"{tmp_path}/keys: exists already; move it away to give the whole fleet new keys, or name another "
        "folder with --out"
    )
    assert (keys.home / "key.pem").read_bytes() == before
    (keys.machines[1].folder / "key.pem").unlink()
    with pytest.raises(AcrcError, match=f"{tmp_path}/keys/r2/key.pem cannot be read"):
        load_keys(keys.machines[1].folder)
    with pytest.raises(AcrcError, match=f"{tmp_path}/none: there are no keys to revoke"):
        renew(FLEET, tmp_path / "none", ["r2"], {}, now=NOW, days=30)


def test_all_keys_are_made_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ValueError("in the middle")

    monkeypatch.setattr("deploy.hosts.certificates.machine", fail)
    with pytest.raises(ValueError, match="in the middle"):
        made(tmp_path / "keys")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("word", ["r2", "r2=", "r2=a b", "r2=-a"])
def test_a_host_that_is_none_is_refused(word: str) -> None:
    with pytest.raises(AcrcError) as caught:
        hosts_of([word], FLEET)
    assert str(caught.value) == (
        f"--host: {shlex.quote(word)}; must be a robot's id and its name or address, such as r2=192.168.1.12"
    )
    names = hosts_of(["r2=a.example", "r2=10.0.0.2", "r1=fd00::1"], FLEET)
    assert names == {"r2": ["a.example", "10.0.0.2"], "r1": ["fd00::1"]}


def test_revoked_keys_are_worth_nothing_to_whoever_has_the_new_ones(tmp_path: Path) -> None:
    old = made(tmp_path / "keys")
    later = NOW + timedelta(days=3)
    new, aside = renew(FLEET, tmp_path / "keys", ["r2"], {"r4": ["10.0.0.4"]}, now=later, days=30)
    assert aside == tmp_path / "keys.until-20300504-120000"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["keys", aside.name]
    assert [one.hosts for one in new.machines[:3]] == [one.hosts for one in old.machines[:3]]
    assert new.machines[3].hosts == ("r4", "r4.local", "10.0.0.4")
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
