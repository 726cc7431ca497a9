"""A strategy that looks for words in all that its process can reach, and writes down where it found them.

It is told them in a cipher, and enciphers what it reads to look for them, so that it puts no copy of them
into its own memory.
"""

import ctypes
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
PAGE = 4096
CIPHER = bytes((byte + 77) % 256 for byte in range(256))
"""Twice applied it is no plain text again."""
NEVER_ENDING = ("zero", "full", "random", "urandom")
CODE_OF_ALL = ("/usr", "/lib", "/lib32", "/lib64", "/libx32", "/bin", "/sbin", "/opt", "/etc", "/nix", "/gnu")
"""The system's own files, which know nothing of a run."""


class Still:
    """Does nothing more."""

    def advance(self, view: View, until: int) -> Decision:
        """Stand."""
        return Decision()


def behaviour(start: Start) -> Behaviour:
    """Look everywhere, once; r1 is also made before the run."""
    if start.robot != "r2":
        return Still()
    words = [bytes.fromhex(word) for word in json.loads((HERE / "words.json").read_text())]
    found = [
        f"{place}: word {number}"
        for places in (_process(), _frames(), _objects(), _files(), _memory())
        for place, content in places
        for number in _inside(content, words)
    ]
    own = Path() if Path("/robot").exists() else HERE
    (own / "found.json").write_text(json.dumps(sorted(set(found))))
    return Still()


def _inside(content: bytes, words: Sequence[bytes]) -> list[int]:
    enciphered = content.translate(CIPHER)
    return [number for number, word in enumerate(words) if word in enciphered]


def _process() -> Iterator[tuple[str, bytes]]:
    yield "sys.argv", repr(sys.argv).encode()
    yield "sys.orig_argv", repr(sys.orig_argv).encode()
    yield "sys.path", repr(sys.path).encode()
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
    """All that is in memory as an object, and all that it refers to."""
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
    except Exception:  # somebody's object that cannot be shown
        return b""


def _files() -> Iterator[tuple[str, bytes]]:
    """Names of all files, and what is in those that are no library's; not of a whole machine."""
    if Path("/proc/self").exists():
        return
    libraries = (*CODE_OF_ALL, sys.prefix, sys.base_prefix)
    for folder, folders, names in os.walk("/"):
        folders[:] = [name for name in folders if str(Path(folder, name)) not in libraries]
        for name in (*folders, *names):
            yield "a file's name", bytes(Path(folder, name))
        if folder.startswith(str(HERE)) or not folder.startswith(_project()):
            for name in names:
                yield str(Path(folder, name)), _content(Path(folder, name))


def _project() -> str:
    """What is the same in every run."""
    return str(Path(sys.modules["actors"].__file__ or "").parents[1])


def _content(path: Path) -> bytes:
    if path.name in NEVER_ENDING or not path.is_file():
        return b""
    try:
        with path.open("rb") as file:
            return file.read(LARGEST)
    except OSError:
        return b""


def _memory() -> Iterator[tuple[str, bytes]]:
    """The process's memory as it is: around all objects, the heap, and the stack with the first arguments."""
    here = ctypes.create_string_buffer(1)
    pages = {id(one) // PAGE for one in gc.get_objects()}
    pages |= {id(part) // PAGE for one in gc.get_objects() for part in gc.get_referents(one)}
    libc = ctypes.CDLL(None)
    libc.sbrk.restype = ctypes.c_void_p
    end = libc.sbrk(ctypes.c_long(0)) // PAGE
    pages |= set(range(end - 20_000, end))
    stack = int(_stack_of(libc)) // PAGE
    pages |= set(range(stack - 100, stack + 3000))
    pages.add(ctypes.addressof(here) // PAGE)
    out, into = os.pipe()
    for first, last in _runs(pages):
        chunk = bytearray()
        for page in range(first, last + 1):
            # write(2) says EFAULT where nothing is, and a look would end the process
            if libc.write(into, ctypes.c_void_p(page * PAGE), PAGE) == PAGE:
                chunk += os.read(out, PAGE)
        yield "memory", bytes(chunk)


def _stack_of(libc: ctypes.CDLL) -> int:
    """Where the environment lies that the process was started with."""
    return ctypes.cast(ctypes.c_void_p.in_dll(libc, "__libc_stack_end"), ctypes.c_void_p).value or 0


def _runs(pages: set[int]) -> Iterator[tuple[int, int]]:
    """Pages that follow one another, as first and last, so that no word is cut by a page's end."""
    first = last = -2
    for page in sorted(pages):
        if page != last + 1 or last - first > 1000:
            if first >= 0:
                yield first, last
            first = page
        last = page
    if first >= 0:
        yield first, last
