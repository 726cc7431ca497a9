"""Authentication of packets by AES-CCM, with the package `cryptography`.

    parameters = NetworkParameters(authenticator=AesCcmAuthenticator(bytes.fromhex("00112233…")))

The levels MIC-32, MIC-64 and MIC-128 of IEEE 802.15.4-2006, 7.6.2: AES-128 in CCM mode (NIST SP 800-38C) with
an empty plaintext. Packets are not encrypted. The nonce is the start of the content's SHA-256. Two contents
under one nonce would weaken the key; so they need a collision of 104 bits, however often epochs repeat.
"""

from hashlib import sha256
from typing import Final

from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from deeco.errors import DeploymentError

KEY_SIZE: Final = 16
"""Bytes of a key."""
TAG_SIZES: Final = (4, 8, 16)
_NONCE_SIZE: Final = 13


class AesCcmAuthenticator:
    """Tags of `tag_size` bytes by AES-CCM: a random one is valid with a probability of 2^(-8 tag_size)."""

    def __init__(self, key: bytes, tag_size: int = 8) -> None:
        """Create an authenticator for one secret key. Raises DeploymentError for a wrong size."""
        if len(key) != KEY_SIZE or tag_size not in TAG_SIZES:
            raise DeploymentError(
                f"AesCcmAuthenticator: the key has {len(key)} bytes and tag_size is {tag_size}; "
                f"use a key of {KEY_SIZE} bytes and a tag_size of 4, 8 or 16"
            )
        self.tag_size = tag_size
        self._cipher = AESCCM(key, tag_length=tag_size)

    def tag(self, content: bytes) -> bytes:
        """Return the tag of a content."""
        return self._cipher.encrypt(sha256(content).digest()[:_NONCE_SIZE], b"", content)
