"""Messages over one TLS connection; neither end ever waits for the other one."""

import socket
import ssl
import struct
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final, Generic, TypeVar

import msgspec

from actors.runtime.errors import AcrcError
from deploy.hosts.host_messages import FromHost, ToHost

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
