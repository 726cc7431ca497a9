"""Control channel between a run and one of its hosts: TLS, message types, non-blocking send and receive."""

import errno
import os
import re
import socket
import ssl
import struct
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Generic, TypeVar

import msgspec

from acrc_testbed.results.seal import Id, Size, Sum
from actors.installation.usage import wrong_value
from actors.runtime.access.credentials import PRIVATE_KEY_FILE
from actors.runtime.access.tls import AUTHORITY_FILE, CERTIFICATE_FILE
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.resource_limits import ProcessLimits
from deploy.clusters.address import host_and_port

Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 31)]
"""Of a process that was asked for, counted over the run."""
Seconds = Annotated[float, msgspec.Meta(ge=0)]
Words = Annotated[str, msgspec.Meta(max_length=2000)]
ERRAND: Final = "errand.json"
RUN: Final = "run"
"""Folder of the run on a host."""
FOLDER: Final = "acrc-"
"""Prefix of the folder of one run in the temporary folder of a host."""


class HostErrand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a host is started with."""

    address: str
    """Where the run was started."""
    port: int
    silence_s: float
    """After so much silence from there it holds itself to be alone, and ends."""
    run: str
    """What the run is known by, drawn for it."""


PART: Final = 1 << 16
"""Bytes of a file that travel together at most."""


class FilePart(msgspec.Struct, frozen=True, tag=True):
    """What comes next in a file, either way."""

    path: Annotated[str, msgspec.Meta(min_length=1, max_length=4096)]
    """With `/`; from a host below the run's folder, to a host below its own."""
    data: Annotated[bytes, msgspec.Meta(max_length=PART)]


class Begin(msgspec.Struct, frozen=True, tag=True):
    """To a host, after the files of its robots: join the mesh."""

    robots: tuple[Id, ...]
    endpoint: str
    """Of the world's router."""
    spawn: str
    limits: ProcessLimits
    code: int
    """How many folders with the strategy's code lie in `code/`."""
    share: tuple[tuple[str, ...], ...]
    """What robots have in common, see `in_common` of the plan."""
    leave: bool
    """Recordings stay where they are."""


class StartRobot(msgspec.Struct, frozen=True, tag=True):
    """To a host: start a robot's process."""

    number: Number
    robot: Id
    setup: bytes
    """Its set-up, as it is written to its file."""


class Signal(msgspec.Struct, frozen=True, tag=True):
    """To a host: send a process a signal."""

    number: Number
    signal: int


class AskPulse(msgspec.Struct, frozen=True, tag=True):
    """To a host, every second: somebody is there, and wants a Pulse."""


class Finish(msgspec.Struct, frozen=True, tag=True):
    """To a host: send what has not been sent, and end."""


class Joined(msgspec.Struct, frozen=True, tag=True):
    """From a host: what its robots say is heard."""

    clock_s: float
    """What its clock shows, since the epoch."""
    folder: Words
    """Where its robots record."""


class Unlinked(msgspec.Struct, frozen=True, tag=True):
    """From a host: its link to the mesh broke, or the mesh has ended."""


class NotStarted(msgspec.Struct, frozen=True, tag=True):
    """From a host: a process that could not be started."""

    number: Number
    why: Words


class Gone(msgspec.Struct, frozen=True, tag=True):
    """From a host: a process has ended; what it has written follows."""

    number: Number


class LeftRecording(msgspec.Struct, frozen=True, tag=True):
    """From a host: the recording of a process that has ended, and stays there."""

    number: Number
    bytes: Size
    sha256: Sum
    notes: dict[str, Annotated[str, msgspec.Meta(max_length=1 << 20)]]
    """Of what its process has noted in it, the ends: `final`, `failure`."""


class EndedProcess(msgspec.Struct, frozen=True, tag=True):
    """From a host: all that a process that has ended had written has been sent."""

    number: Number
    code: Annotated[int, msgspec.Meta(ge=-64, le=255)]
    strays: Annotated[int, msgspec.Meta(ge=0)]
    cpu_s: Seconds


class Glimpse(msgspec.Struct, frozen=True, array_like=True):
    """One process on a host, as of `process_table`."""

    pid: Number
    parent: Number
    session: Number
    state: Annotated[str, msgspec.Meta(min_length=1, max_length=1)]
    cpu_s: Seconds
    queued_s: Seconds | None


class Pulse(msgspec.Struct, frozen=True, tag=True):
    """From a host, in answer to AskPulse."""

    processes: Annotated[tuple[Glimpse, ...], msgspec.Meta(max_length=100_000)]
    """The robots' processes, and what they have started."""
    started: dict[int, Number]
    """Their process ids by the numbers under which they were asked for."""


class Fault(msgspec.Struct, frozen=True, tag=True):
    """From a host: why the run cannot go on."""

    why: Words


class Done(msgspec.Struct, frozen=True, tag=True):
    """From a host: everything has been sent, nothing is left there."""


ToHost = FilePart | Begin | StartRobot | Signal | AskPulse | Finish
FromHost = (
    FilePart | Joined | Unlinked | NotStarted | Gone | LeftRecording | EndedProcess | Pulse | Fault | Done
)


M = TypeVar("M")
LONGEST: Final = 1 << 22
"""Bytes of a message: a Pulse of some ten thousand processes."""
_CHUNK: Final = 1 << 14
"""Bytes of a record of TLS (RFC 8446, 5.1)."""
_LENGTH: Final = struct.Struct("<I")


class ChannelClosedError(AcrcError):
    """The other end is gone, or says what is no message."""


class Channel(Generic[M]):
    """Sends anything that msgspec encodes, and receives messages of one kind."""

    def __init__(self, encrypted: ssl.SSLSocket, kind: Any) -> None:
        encrypted.setblocking(False)
        encrypted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = encrypted
        self._decoder: msgspec.msgpack.Decoder[M] = msgspec.msgpack.Decoder(kind)
        self._encoder = msgspec.msgpack.Encoder()
        self._out: deque[bytes] = deque()
        self._in = bytearray()
        self.waiting = 0
        """Bytes that have not been sent."""

    def fileno(self) -> int:
        """For `select`: readable when something may have come."""
        return self._socket.fileno()

    def send(self, message: msgspec.Struct) -> None:
        """Send now, or with `flush`. Raises ChannelClosedError."""
        data = self._encoder.encode(message)
        data = _LENGTH.pack(len(data)) + data
        self._out.extend(data[start : start + _CHUNK] for start in range(0, len(data), _CHUNK))
        self.waiting += len(data)
        self.flush()

    def flush(self) -> None:
        """Send as much as goes without waiting. Raises ChannelClosedError."""
        try:
            while self._out:
                self._socket.send(self._out[0])
                self.waiting -= len(self._out.popleft())
        except (ssl.SSLWantWriteError, ssl.SSLWantReadError):
            return
        except (OSError, ValueError) as error:
            raise ChannelClosedError(_words(error)) from None

    def receive(self) -> Iterator[M]:
        """What has come. Raises ChannelClosedError, after what came before."""
        closed: ChannelClosedError | None = None
        try:
            while True:
                piece = self._socket.recv(1 << 16)
                if not piece:
                    closed = ChannelClosedError("the connection was closed")
                    break
                self._in += piece
        except (ssl.SSLWantReadError, ssl.SSLWantWriteError):
            pass
        except (OSError, ValueError) as error:
            closed = ChannelClosedError(_words(error))
        yield from self._whole()
        if closed is not None:
            raise closed

    def close(self) -> None:
        """Close the connection; what waits is lost."""
        with suppress(OSError):
            self._socket.close()

    def _whole(self) -> Iterator[M]:
        while len(self._in) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._in)
            if length > LONGEST:
                raise ChannelClosedError(
                    f"a message of {length} bytes was announced, at most {LONGEST} may come"
                )
            end = _LENGTH.size + length
            if len(self._in) < end:
                return
            data = bytes(self._in[_LENGTH.size : end])
            del self._in[:end]
            try:
                yield self._decoder.decode(data)
            except msgspec.MsgspecError as error:
                raise ChannelClosedError(f"something came that is no message: {error}") from None


def to_host(encrypted: ssl.SSLSocket) -> "Channel[FromHost]":
    """The end where the run was started."""
    return Channel(encrypted, FromHost)


def from_host(encrypted: ssl.SSLSocket) -> "Channel[ToHost]":
    """The end on a host."""
    return Channel(encrypted, ToHost)


def _words(error: Exception) -> str:
    return f"the connection broke: {getattr(error, 'strerror', None) or error}"


_PLACE: Final = re.compile(r"(?P<host>[\w.-]+|\[[0-9A-Fa-f:]+\])(?::(?P<port>[0-9]{1,5}))?")


def place_of(word: str) -> tuple[str, int]:
    """What `--listen HOST` or `--listen HOST:PORT` says; port 0: any two. Raises OptionError."""
    found = _PLACE.fullmatch(word)
    port = int(found["port"] or 0) if found else -1
    if found is None or not 0 <= port < 65535:
        expected = (
            "an address of this computer, with the first of two ports or without, such as 10.0.0.5:7450"
        )
        raise wrong_value("--listen", word, expected)
    return found["host"].strip("[]"), port


def own_address(address: str) -> str:
    """Under which the scheduler's computer, and so its workers, see this one."""
    place = host_and_port(address)
    family, kind, proto, _, where = socket.getaddrinfo(*place, type=socket.SOCK_DGRAM)[0]
    with socket.socket(family, kind, proto) as probe:
        probe.connect(where)  # of a datagram socket: nothing is sent
        return str(probe.getsockname()[0])


def bound(address: str) -> str:
    """Where to listen for those who connect to `address`: there, or everywhere if this computer is reached
    by another's address. Raises AcrcError."""
    try:
        with socket.create_server((address, 0), family=_family(address)):
            return address
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            return "::" if ":" in address else "0.0.0.0"
        raise AcrcError(
            f"--listen: {address}: {error.strerror}; must be an address of this computer"
        ) from None


def listening(address: str, port: int) -> socket.socket:
    """A socket that listens there, at any port if that is 0. Raises AcrcError."""
    try:
        return socket.create_server((address, port), family=_family(address))
    except OSError as error:
        raise AcrcError(
            f"--listen: cannot listen at {bracketed(address)}:{port}: {error.strerror}; must be two ports "
            "that nobody has, such as 7450 and the next"
        ) from None


def free_port(address: str) -> int:
    """A port there that nobody has now. Raises AcrcError."""
    with listening(address, 0) as probe:
        return int(probe.getsockname()[1])


def bracketed(address: str) -> str:
    """The address as it stands before a port."""
    return f"[{address}]" if ":" in address else address


def _family(address: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in address else socket.AF_INET


@dataclass(frozen=True)
class PemKeys:
    """With what one computer of the run proves who it is, in PEM."""

    authority: bytes
    certificate: bytes
    private_key: bytes

    def write(self, folder: Path) -> None:
        """Into a folder for its owner's eyes; it may be there already."""
        folder.mkdir(mode=0o700, exist_ok=True)
        (folder / AUTHORITY_FILE).write_bytes(self.authority)
        (folder / CERTIFICATE_FILE).write_bytes(self.certificate)
        handle = os.open(folder / PRIVATE_KEY_FILE, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(self.private_key)


def server_context(folder: Path) -> ssl.SSLContext:
    """For whoever waits for hosts, with the keys in the folder."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    _load(context, folder)
    return context


def client_context(folder: Path) -> ssl.SSLContext:
    """For a host, with the keys in the folder."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    _load(context, folder)
    return context


def connect(folder: Path, address: str, port: int, patience_s: float) -> ssl.SSLSocket:
    """Connect a host, with the keys in the folder. Raises OSError."""
    plain = socket.create_connection((address, port), timeout=patience_s)
    return client_context(folder).wrap_socket(plain, server_hostname=address)


def common_name(encrypted: ssl.SSLSocket) -> str:
    """Of the certificate that the other end has shown; empty if there is none."""
    shown = encrypted.getpeercert() or {}
    subject: tuple[tuple[tuple[str, str], ...], ...] = shown.get("subject", ())  # type: ignore[assignment]
    return next((value for part in subject for key, value in part if key == "commonName"), "")


def _load(context: ssl.SSLContext, folder: Path) -> None:
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.verify_mode = ssl.CERT_REQUIRED
    context.load_verify_locations(folder / AUTHORITY_FILE)
    context.load_cert_chain(folder / CERTIFICATE_FILE, folder / PRIVATE_KEY_FILE)
