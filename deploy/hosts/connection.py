"""Connection to a Dask cluster: TLS, workers and their results."""

import logging
import socket
import ssl
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from distributed import CancelledError, Client, Future, Security, wait

from actors.runtime.errors import AcrcError, printable
from deploy.hosts.address import PAGE, host_and_port, is_safe


class ClusterError(AcrcError):
    """A missing or unusable cluster."""


_KEYS: Final = {"ca_file": "ca-file", "cert": "client.cert", "key": "client.key"}
"""Required settings and their keys below distributed.comm.tls in Dask's configuration."""


def create_security(address: str, timeout_s: float, option: str = "--on") -> Security:
    """Return the credentials for a tls:// address, after a test connection with precise errors.

    `option`: option or argument with the address. Raises ClusterError if the configuration is incomplete or
    either side rejects the other's certificate.
    """
    security = Security(require_encryption=True)
    files = security.get_tls_config_for_role("client")
    context = _tls_context(security, files, address, option)
    try:
        with (
            socket.create_connection(host_and_port(address), timeout=timeout_s) as plain,
            context.wrap_socket(plain) as encrypted,
        ):
            encrypted.recv(
                1
            )  # a scheduler sends first; if it has rejected the certificate, this raises the reason
    except ssl.SSLCertVerificationError as error:
        raise ClusterError(
            f"{option} {address}: the scheduler's certificate is not accepted: {error.verify_message}; must "
            f"be signed by the ca-file {files['ca_file']}, and valid now ({PAGE})"
        ) from None
    except ssl.SSLError as error:
        raise ClusterError(
            f"{option} {address}: the scheduler rejects the certificate {files['cert']}, or has "
            f"no TLS: {(error.reason or 'connection closed').lower().replace('_', ' ')} ({PAGE})"
        ) from None
    except OSError as error:
        raise ClusterError(
            f"{option} {address}: no Dask scheduler answers there: {error.strerror or error}"
        ) from None
    return security


def _tls_context(
    security: Security, files: Mapping[str, str | None], address: str, option: str
) -> ssl.SSLContext:
    for name, key in _KEYS.items():
        path = files[name]
        where = f"distributed.comm.tls.{key} in Dask's configuration"
        if not path:
            raise ClusterError(f"{option} {address}: {where} is not set; it must name a PEM file ({PAGE})")
        if not Path(path).is_file():
            raise ClusterError(f"{option} {address}: {where} is {path}, which is not a file ({PAGE})")
    try:
        context: ssl.SSLContext = security.get_connection_args("client")["ssl_context"]
    except (OSError, ValueError) as error:
        raise ClusterError(
            f"{option} {address}: {', '.join(str(path) for path in files.values() if path)}: cannot be used "
            f"as authority, certificate and its key: {error}"
        ) from None
    return context


TIMEOUT_S: Final = 10.0
_CHECK_INTERVAL_S: Final = 5.0
"""Interval of checks for the reason of a delay, s."""


def connect(address: str) -> Client:
    """Connect to a cluster that has workers and admits only clients with a key.

    `address`: tls://HOST:PORT of the scheduler, or tcp:// on this computer. Raises ClusterError.
    """
    for name in ("distributed", "distributed.client"):  # errors are raised as well
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        security = create_security(address, TIMEOUT_S) if address.startswith("tls://") else None
        client = Client(address, timeout=TIMEOUT_S, security=security)
    except (OSError, ValueError) as error:
        raise ClusterError(f"--on {address}: no Dask scheduler answers there: {error_line(error)}") from None
    try:
        check_tls(client, address)
        if not client.nthreads():
            raise ClusterError(
                f"--on {address}: has no workers; start one with: ./acrc cluster join {address}"
            )
    except ClusterError:
        client.close(timeout=TIMEOUT_S)
        raise
    return client


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """Connect as `connect`; disconnect at the end."""
    client = connect(address)
    try:
        yield client
    finally:
        with suppress(Exception):  # any error of the library about a lost cluster
            client.close(timeout=TIMEOUT_S)


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


def error_line(error: Exception) -> str:
    """Return the first line of an error's message, truncated; without a message its repr."""
    return printable(str(error).partition("\n")[0][:500] or repr(error))


def host_workers(client: Client) -> list[str]:
    """Return the address of one worker on each computer, sorted by address."""
    first: dict[str, str] = {}
    for worker in sorted(map(str, client.nthreads())):
        first.setdefault(host_and_port(worker)[0], worker)
    return list(first.values())


def await_result(client: Client, address: str, worker: str, future: Future[Any]) -> Any:
    """Wait for a worker's result; report a delay once, with its reason.

    Raises ClusterError if the worker has left or the scheduler is lost, and any exception of the task.
    """
    is_reported = False
    try:
        while not future.done():
            try:
                wait(future, timeout=_CHECK_INTERVAL_S)
            except TimeoutError:
                reason = _delay_reason(client, address, worker, future)
                if not is_reported:
                    sys.stderr.write(f"acrc: --on {address}: waiting for the worker {worker}{reason}\n")
                is_reported = True
        return future.result()
    except CancelledError:
        raise ClusterError(f"--on {address}: the scheduler does not answer any more ({PAGE})") from None


def _delay_reason(client: Client, address: str, worker: str, future: Future[Any]) -> str:
    """Return the reason of a delay as a clause; empty if unknown.

    Raises ClusterError if the worker has left.
    """
    if worker not in client.nthreads():
        raise ClusterError(f"--on {address}: the worker {worker} has left the cluster ({PAGE})")
    others = {*client.processing([worker]).get(worker, ())} - {future.key}
    return "; it is busy, as with another run or a campaign" if others else ""
