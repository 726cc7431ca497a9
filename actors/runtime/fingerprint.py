"""What the numeric kernels give on fixed inputs here: numpy and numba may differ in the last bit by CPU."""

import hashlib
from collections.abc import Iterable
from typing import Protocol


class KernelModule(Protocol):
    """A module with kernels."""

    __name__: str

    def fingerprint(self) -> bytes:
        """The bytes that its kernels give on fixed inputs."""


def fingerprints(modules: Iterable[KernelModule]) -> dict[str, str]:
    """The sha256 of each module's fingerprint, by the module's name."""
    return {module.__name__: hashlib.sha256(module.fingerprint()).hexdigest() for module in modules}


def combined(prints: dict[str, str]) -> str:
    """One hash over all of them."""
    lines = "".join(f"{name} {value}\n" for name, value in sorted(prints.items()))
    return hashlib.sha256(lines.encode()).hexdigest()
