"""A strategy that searches everything that its process can reach for given words.

The words are enciphered, so that the strategy itself puts no copy of them into memory.
"""

import gc
import json
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType

from actors.robot.behaviour.ports import Behaviour, Decision, Start, View

HERE = Path(__file__).parent
LARGEST = 8_000_000
"""Bytes of a file that are read."""
CIPHER = bytes((byte + 77) % 256 for byte in range(256))
NEVER_ENDING = ("zero", "full", "random", "urandom")
SYSTEM = ("/usr", "/lib", "/lib32", "/lib64", "/libx32", "/bin", "/sbin", "/opt", "/etc", "/nix", "/gnu")


class Still:
    def advance(self, view: View, until: int) -> Decision:
        return Decision()


def behaviour(start: Start) -> Behaviour:
    if start.robot != "r2":
        return Still()
    words = [bytes.fromhex(word) for word in json.loads((HERE / "words.json").read_text())]
    found = {
        f"{place}: word {number}"
        for places in (_process(), _frames(), _objects(), _files())
        for place, content in places
        for number in _inside(content, words)
    }
    own = Path() if Path("/robot").exists() else HERE
    (own / "found.json").write_text(json.dumps(sorted(found)))
    return Still()


def _inside(content: bytes, words: Sequence[bytes]) -> list[int]:
    enciphered = content.translate(CIPHER)
    return [number for number, word in enumerate(words) if word in enciphered]


def _process() -> Iterator[tuple[str, bytes]]:
    for name in ("argv", "orig_argv", "path"):
        yield f"sys.{name}", repr(getattr(sys, name)).encode()
    yield "environment", repr(dict(os.environ)).encode()
    yield "working directory", str(Path.cwd()).encode()
    yield "modules", repr({name: getattr(one, "__file__", "") for name, one in sys.modules.items()}).encode()


def _frames() -> Iterator[tuple[str, bytes]]:
    frame: FrameType | None = sys._getframe()
    while frame is not None:
        for scope in (frame.f_locals, frame.f_globals):
            for name, value in list(scope.items()):
                yield f"frame {frame.f_code.co_name}, {name}", _text(value)
        frame = frame.f_back


def _objects() -> Iterator[tuple[str, bytes]]:
    for one in gc.get_objects():
        for part in gc.get_referents(one):
            if isinstance(part, str | bytes | bytearray | int | os.PathLike):
                yield f"an object of {type(one).__name__}", _text(part)


def _text(value: object) -> bytes:
    if isinstance(value, bytes | bytearray):
        return bytes(value)
    if isinstance(value, int):
        size = max(8, (value.bit_length() + 7) // 8 + 1)
        both = [value.to_bytes(size, order, signed=True) for order in ("little", "big")]
        return b" ".join((str(value).encode(), hex(value).encode(), *both))
    try:
        return repr(value).encode(errors="replace")
    except Exception:  # an object without a representation
        return b""


def _files() -> Iterator[tuple[str, bytes]]:
    if Path("/proc/self").exists():
        return
    project = str(Path(sys.modules["actors"].__file__ or "").parents[1])
    libraries = (*SYSTEM, sys.prefix, sys.base_prefix)
    for folder, folders, names in os.walk("/"):
        folders[:] = [name for name in folders if str(Path(folder, name)) not in libraries]
        for name in (*folders, *names):
            yield "a file's name", bytes(Path(folder, name))
        if folder.startswith(str(HERE)) or not folder.startswith(project):
            for name in names:
                yield str(Path(folder, name)), _content(Path(folder, name))


def _content(path: Path) -> bytes:
    if path.name in NEVER_ENDING or not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(LARGEST)
    except OSError:
        return b""
