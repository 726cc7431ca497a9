"""A relay that runs on a host, and takes orders from whoever started it."""

import subprocess
import sys
from types import TracebackType
from typing import Self

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from benchmarks.hosts.host import RigHost


class RelayError(AcrcError):
    """A relay that does not start, or does not do what it was told."""


class RelayProcess:
    """The program `benchmarks.hosts.relay` on a host; a context manager that ends it."""

    address: str
    """HOST:PORT where it listens."""

    def __init__(self, host: RigHost, listen: str, target: str, *, delay_ms: float = 0.0) -> None:
        """From HOST:PORT of the host, port 0 for any that is free, to HOST:PORT as the host reaches it."""
        self._name = f"relay on {host.name}, {listen} to {target}"
        words = ("benchmarks.hosts.relay", listen, target, "--delay-ms", f"{delay_ms:g}")
        self._command = host.command([sys.executable, "-P", "-m", *words])

    def __enter__(self) -> Self:
        """Raises RelayError where it cannot listen."""
        self._process = subprocess.Popen(
            self._command,
            cwd=REPOSITORY,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        word, _, self.address = self._answer().partition(" ")
        if word != "ready":
            _, said = self._process.communicate()
            raise RelayError(f"{self._name}: {said.strip()}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()

    def tell(self, order: str) -> None:
        """Give an order, which is in force afterwards. Raises RelayError where it is refused."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{order}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise RelayError(f"{self._name}: has ended") from None
        if (answer := self._answer()) != "ok":
            raise RelayError(f"{self._name}: {answer or 'has ended'}")

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()
