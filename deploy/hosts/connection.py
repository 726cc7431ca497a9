"""Connection to a Dask cluster: TLS and answers of workers."""

import logging
import socket
import ssl
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from distributed import CancelledError, Client, Future, Security, wait

from actors.runtime.errors import AcrcError
from deploy.hosts.address import PAGE, host_and_port, is_safe


class ClusterError(AcrcError):
    """A missing or unusable cluster."""


_KEYS: Final = {"ca_file": "ca-file", "cert": "client.cert", "key": "client.key"}
"""Required settings and their keys below distributed.comm.tls in Dask's configuration."""


def security(address: str, patience_s: float, named: str = "--on") -> Security:
    """Return the credentials for a tls:// address after a test connection, which gives precise errors.

    `named`: option or argument with the address. Raises ClusterError if the configuration is incomplete or
    either side rejects the other's certificate.
    """
    given = Security(require_encryption=True)
    files = given.get_tls_config_for_role("client")
    context = _context(given, files, address, named)
    try:
        with (
            socket.create_connection(host_and_port(address), timeout=patience_s) as plain,
            context.wrap_socket(plain) as encrypted,
        ):
            encrypted.recv(1)  # a scheduler sends first; after a rejection this raises the reason
    except ssl.SSLCertVerificationError as error:
        raise ClusterError(
            f"{named} {address}: the scheduler's certificate is not accepted: {error.verify_message}; must "
            f"be signed by the ca-file {files['ca_file']}, and valid now ({PAGE})"
        ) from None
    except ssl.SSLError as error:
        raise ClusterError(
            f"{named} {address}: the scheduler rejects the certificate {files['cert']}, or has "
            f"no TLS: {(error.reason or 'connection closed').lower().replace('_', ' ')} ({PAGE})"
        ) from None
    except OSError as error:
        raise ClusterError(
            f"{named} {address}: no Dask scheduler answers there: {error.strerror or error}"
        ) from None
    return given


def _context(given: Security, files: Mapping[str, str | None], address: str, named: str) -> ssl.SSLContext:
    for name, key in _KEYS.items():
        path = files[name]
        where = f"distributed.comm.tls.{key} in Dask's configuration"
        if not path:
            raise ClusterError(f"{named} {address}: {where} is not set; it must name a PEM file ({PAGE})")
        if not Path(path).is_file():
            raise ClusterError(f"{named} {address}: {where} is {path}, which is not a file ({PAGE})")
    try:
        context: ssl.SSLContext = given.get_connection_args("client")["ssl_context"]
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"{named} {address}: {', '.join(str(path) for path in files.values() if path)}: cannot be used "
            f"as authority, certificate and its key: {error}"
        ) from None
    return context


PATIENCE_S: Final = 10.0
_LOOK_S: Final = 5.0
"""Interval of checks for the reason of a delay, s."""


def connect(address: str) -> Client:
    """Connect to a cluster with workers that admits only clients with a key.

    `address`: tls://HOST:PORT of the scheduler, or tcp:// on this computer. Raises ClusterError.
    """
    for name in ("distributed", "distributed.client"):  # errors are also raised
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        given = security(address, PATIENCE_S) if address.startswith("tls://") else None
        client = Client(address, timeout=PATIENCE_S, security=given)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise ClusterError(f"--on {address}: no Dask scheduler answers there: {reason}") from None
    try:
        check_tls(client, address)
        if not client.nthreads():
            raise ClusterError(
                f"--on {address}: has no workers; start one with: ./acrc cluster join {address}"
            )
    except ClusterError:
        client.close(timeout=PATIENCE_S)
        raise
    return client


def check_tls(client: Client, address: str) -> None:
    """Raise ClusterError if the cluster accepts remote clients without a key."""
    about = client.scheduler_info(n_workers=-1)
    for listener in (str(about["address"]), *map(str, about["workers"])):
        if not is_safe(listener):
            raise ClusterError(
                f"--on {address}: listens at {listener} without TLS, so anyone who can connect can execute "
                f"code; use TLS, or listen at 127.0.0.1 ({PAGE})"
            )
    if address.startswith("tcp://"):
        sys.stderr.write(
            f"acrc: --on {address}: has no TLS: all users of this computer can execute code as you\n"
        )


def machines(client: Client) -> list[str]:
    """Return the address of one worker on each computer, sorted by address."""
    first: dict[str, str] = {}
    for worker in sorted(map(str, client.nthreads())):
        first.setdefault(host_and_port(worker)[0], worker)
    return list(first.values())


def answer(client: Client, address: str, worker: str, future: Future[Any]) -> Any:
    """Wait for a worker's result; report a delay once, with its reason.

    Raises ClusterError if the worker has left or the scheduler is lost, and any exception of the task.
    """
    is_reported = False
    try:
        while not future.done():
            try:
                wait(future, timeout=_LOOK_S)
            except TimeoutError:
                why = _why(client, address, worker, future)
                if not is_reported:
                    sys.stderr.write(f"acrc: --on {address}: waiting for the worker {worker}{why}\n")
                is_reported = True
        return future.result()
    except CancelledError:
        raise ClusterError(f"--on {address}: the scheduler does not answer any more ({PAGE})") from None


def _why(client: Client, address: str, worker: str, future: Future[Any]) -> str:
    """Return the reason of a delay; empty if unknown. Raises ClusterError if the worker has left."""
    if worker not in client.nthreads():
        raise ClusterError(f"--on {address}: the worker {worker} has left the cluster ({PAGE})")
    others = {*client.processing([worker]).get(worker, ())} - {future.key}
    return "; it is busy, as with another run or a campaign" if others else ""
