"""Certificate authority and certificates of fleets and runs: X.509 version 3 (RFC 5280), ECDSA on P-256.

All private keys are generated on the computer of the authority; users copy a fleet's to its machines.
"""

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric.ec import (
    SECP256R1,
    EllipticCurvePrivateKey,
    generate_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID, ObjectIdentifier

from actors.runtime.isolation.credentials import PRIVATE_KEY_FILE, write_secret
from actors.runtime.isolation.tls import AUTHORITY_FILE, CERTIFICATE_FILE

SERVER = ExtendedKeyUsageOID.SERVER_AUTH
"""Purpose of a robot, which accepts connections; with no other, its key cannot connect to other robots."""
CLIENT = ExtendedKeyUsageOID.CLIENT_AUTH
"""Purpose of an operator station, which connects to robots, and of robots that connect to a radio medium."""
_BACKDATED = timedelta(days=1)
"""Backdating of certificates, for clocks that are behind."""


@dataclass(frozen=True)
class CertifiedKey:
    """Private key with the certificate of its public key."""

    private_key: EllipticCurvePrivateKey
    certificate: x509.Certificate

    @property
    def private_pem(self) -> bytes:
        """The private key, PKCS #8 in PEM, not encrypted."""
        return self.private_key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )

    @property
    def certificate_pem(self) -> bytes:
        """The certificate in PEM."""
        return self.certificate.public_bytes(serialization.Encoding.PEM)


def create_authority(name: str, now: datetime, days: int) -> CertifiedKey:
    """Create a self-signed certificate authority, which cannot sign other authorities."""
    key = generate_private_key(SECP256R1())
    builder = _certificate_builder(name, None, key, now, days)
    return CertifiedKey(key, builder.sign(key, hashes.SHA256()))


def issue_certificate(
    issuer: CertifiedKey,
    name: str,
    purposes: Sequence[ObjectIdentifier],
    hosts: Sequence[str],
    now: datetime,
    days: int,
) -> CertifiedKey:
    """Create a key and a certificate for one machine; purposes: SERVER, CLIENT.

    `hosts`: names and addresses of the machine.
    """
    key = generate_private_key(SECP256R1())
    builder = _certificate_builder(name, issuer.certificate.subject, key, now, days)
    builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
    if hosts:
        names = x509.SubjectAlternativeName([general_name(host) for host in hosts])
        builder = builder.add_extension(names, critical=False)
    signer = x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer.private_key.public_key())
    builder = builder.add_extension(signer, critical=False)
    return CertifiedKey(key, builder.sign(issuer.private_key, hashes.SHA256()))


def general_name(host: str) -> x509.DNSName | x509.IPAddress:
    """Return an IP address or DNS name as an X.509 general name."""
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def host_names(certificate: x509.Certificate) -> tuple[str, ...]:
    """Return the subject alternative names."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    return tuple(str(name.value) for name in names if isinstance(name, x509.DNSName | x509.IPAddress))


def common_name(certificate: x509.Certificate) -> str:
    """Return the subject's common name; empty if it has none."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""


def load_certificate(pem: bytes) -> x509.Certificate:
    """Load a PEM certificate. Raises ValueError."""
    return x509.load_pem_x509_certificate(pem)


def _certificate_builder(
    name: str, issuer: x509.Name | None, key: EllipticCurvePrivateKey, now: datetime, days: int
) -> x509.CertificateBuilder:
    """Return a builder with validity, key, and what the key may sign; no issuer: that of an authority."""
    subject, is_authority = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]), issuer is None
    begin = now.astimezone(UTC)
    builder = x509.CertificateBuilder(subject_name=subject, issuer_name=issuer or subject)
    builder = builder.public_key(key.public_key()).serial_number(x509.random_serial_number())
    builder = builder.not_valid_before(begin - _BACKDATED).not_valid_after(begin + timedelta(days=days))
    own = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
    constraints = x509.BasicConstraints(ca=is_authority, path_length=0 if is_authority else None)
    no = dict.fromkeys(
        ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement"), False
    )
    usage = x509.KeyUsage(
        digital_signature=not is_authority, key_cert_sign=is_authority, crl_sign=is_authority,
        encipher_only=False, decipher_only=False, **no,
    )  # fmt: skip
    builder = builder.add_extension(own, critical=False).add_extension(constraints, critical=True)
    return builder.add_extension(usage, critical=True)


@dataclass(frozen=True)
class PemKeys:
    """Certificates and key of one computer, in PEM; the authority has no certificate beside its own."""

    authority: bytes
    certificate: bytes
    private_key: bytes

    def write(self, folder: Path) -> None:
        """Write the files into a folder that only its owner can read."""
        folder.mkdir(mode=0o700, exist_ok=True)
        (folder / AUTHORITY_FILE).write_bytes(self.authority)
        if self.certificate:
            (folder / CERTIFICATE_FILE).write_bytes(self.certificate)
        write_secret(folder / PRIVATE_KEY_FILE, self.private_key.decode().removesuffix("\n"))


_DAYS: Final = 30
"""Validity in days, longer than any run; each run has new keys."""


def create_run_keys(hosts: Sequence[str], address: str) -> tuple[PemKeys, dict[str, PemKeys]]:
    """Create the keys of one run: of this computer at `address`, and by name of the hosts."""
    now = datetime.now(UTC)
    issuer = create_authority("run", now, _DAYS)
    world = issue_certificate(issuer, "world", [SERVER], [address], now, _DAYS)
    host_keys = {name: issue_certificate(issuer, name, [CLIENT], [], now, _DAYS) for name in hosts}
    return pem_keys(issuer, world), {name: pem_keys(issuer, pair) for name, pair in host_keys.items()}


def pem_keys(issuer: CertifiedKey, pair: CertifiedKey) -> PemKeys:
    """Return the files of the computer with this key."""
    return PemKeys(issuer.certificate_pem, pair.certificate_pem, pair.private_pem)
