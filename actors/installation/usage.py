"""What is wrong with a command, before anything has run."""

import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError

_LONGEST = 60
"""Characters of a value that a sentence shows."""
_EXTRAS: Final = {
    "cryptography": "hardware",
    "distributed": "cluster",
    "jinja2": "pictures",
    "matplotlib": "pictures",
    "pyarrow": "experiments",
    "pymunk": "sim",
    "rerun": "observe",
    "rosbags": "logs",
    "scipy": "experiments",
    "serial": "hardware",
    "websockets": "control",
}
"""Packages beyond the base, as they are imported, with the extra of pyproject.toml that brings each."""


def command() -> str:
    """How the command line is called from where the user stands, in words for a shell."""
    script = REPOSITORY / "acrc"
    if not script.is_file():
        return "acrc"  # an installed package has it on the PATH
    return "./acrc" if script.parent == Path.cwd() else shlex.quote(str(script))


def typed(*words: object, modules: Iterable[Path] = ()) -> str:
    """Return a command line that works when it is pasted into a shell in the current folder.

    `modules`: folders for `--modules`. Paths below the current folder are relative.
    """
    own = (word for folder in modules for word in ("--modules", folder))
    return f"{command()} {shlex.join(_near(word) for word in (*words, *own))}"


def _near(word: object) -> str:
    here = Path.cwd()
    return str(word.relative_to(here) if isinstance(word, Path) and word.is_relative_to(here) else word)


class OptionError(AcrcError):
    """An option of the command line that makes no sense.

    The sentence is of one form for all: what is wrong, with which value; what would be right.
    """


@contextmanager
def extras_named() -> Iterator[None]:
    """Name the extra where a package of one is not installed. Raises AcrcError for that."""
    try:
        yield
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        if extra is None:
            raise
        raise AcrcError(
            f"Python package {error.name} is not installed; install it with: pip install "
            f"'acrc-testbed[{extra}]'"
        ) from error


def output_file(option: str, path: Path, *suffixes: str) -> Path:
    """Return the file that an option names. Raises OptionError for another suffix or without its folder."""
    if path.suffix not in suffixes or not path.absolute().parent.is_dir():
        right = f"a file in a folder that exists, its name ending in {' or '.join(suffixes)}"
        raise wrong_value(option, path, right)
    return path


def check_choice(option: str, value: str | None, choices: Iterable[str]) -> None:
    """Raise OptionError if the value is none of the choices; None: the option was not given."""
    if value is not None and value not in choices:
        raise wrong_value(option, value, " or ".join(choices))


def wrong_value(option: str, value: object, right: str) -> OptionError:
    """The error that `option` has this value; `right` goes on after "must be"."""
    text = str(value)
    if len(text) > _LONGEST:
        text = f"{text[:_LONGEST]}…"
    return OptionError(f"{option}: {shlex.quote(text)}; must be {right}")
