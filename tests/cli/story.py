"""Command lines that are typed one after the other in a folder, and what each of them shows or makes."""

import os
import pty
import re
import select
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from tests import warm

ROOT = Path(__file__).parents[2]
PATIENCE_S = 250.0
CTRL_C = "\x03"


@dataclass(frozen=True)
class Line:
    """`acrc WORDS`, typed in a shell without wildcards; `{name}` stands for what the story gives."""

    words: str
    shows: str = ""
    """A pattern of what it prints, on either stream."""
    makes: str = ""
    """A file that it writes, with something in it."""
    typed: str = ""
    """It has a terminal, and this is typed once `shows` is there; CTRL_C: it is interrupted."""
    beside: bool = False
    """It goes on; what follows it is typed once `shows` is there, and it has ended when the story has."""
    codes: tuple[int, ...] = (0,)
    """With one of which it ends."""
    needs: str = ""
    """A package that not every installation has; without it the line is passed over."""


def tell(
    lines: Sequence[Line],
    folder: Path,
    given: Mapping[str, str],
    env: Mapping[str, str],
    program: str = warm.ACRC,
) -> None:
    """Type the lines; AssertionError for the first that does not do what it should."""
    with ExitStack() as stack:
        for line in lines:
            if line.needs and find_spec(line.needs) is None:
                continue
            words = [word.format_map(given) for word in shlex.split(line.words)]
            if line.beside or line.typed:
                stack.callback(_begun(line, words, folder, env, stack))
                continue
            done = warm.run(words, folder, env, PATIENCE_S, finds_cwd=False, program=program)
            _judge(line, done.returncode, done.stdout + done.stderr, folder)


def _judge(line: Line, code: int, said: str, folder: Path) -> None:
    assert code in line.codes, f"acrc {line.words}: {code}: {said[-2000:]}"
    assert re.search(line.shows, said, re.M), f"acrc {line.words}: {said[-3000:]}"
    made = folder / line.makes
    assert not line.makes or made.stat().st_size > 0, f"acrc {line.words}: {made}"


def _begun(
    line: Line, words: Sequence[str], folder: Path, env: Mapping[str, str], stack: ExitStack
) -> Callable[[], None]:
    """Start it, and read until it shows what it should; what is to be called at the story's end."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-P", "-m", "command_line", *words]
    process = subprocess.Popen(command, cwd=folder, env=env, stdin=theirs, stdout=theirs, stderr=theirs)
    stack.callback(process.wait)
    stack.callback(process.kill)
    stack.callback(os.close, ours)
    os.close(theirs)
    said, ended = bytearray(), time.monotonic() + PATIENCE_S

    def more() -> bool:
        ready, _, _ = select.select([ours], [], [], max(0.0, ended - time.monotonic()))
        assert ready, f"nothing more came after {bytes(said[-2000:])!r}"
        try:
            said.extend(piece := os.read(ours, 4096))
        except OSError:  # nobody has the terminal any more
            return False
        return bool(piece)

    while not re.search(line.shows.encode(), said) and more():
        pass
    if line.typed == CTRL_C:
        process.send_signal(signal.SIGINT)
    else:
        os.write(ours, line.typed.encode())

    def end() -> None:
        while more():
            pass
        _judge(line, process.wait(30), said.decode(errors="replace").replace("\r", ""), folder)

    if line.typed:
        end()
        return lambda: None
    return end
