"""Command lines: how to call `acrc`, and errors in options."""

import shlex
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError

_LONGEST = 60
"""Most characters of a value in a message."""
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
"""Optional packages, by import name, with the extra of pyproject.toml that installs each."""


def command_name() -> str:
    """Return how to call the command line from the current folder, for a shell."""
    script = REPOSITORY / "acrc"
    if not script.is_file():
        return "acrc"  # an installed package has it on the PATH
    return "./acrc" if script.parent == Path.cwd() else shlex.quote(str(script))


def command_line(*words: object, modules: Iterable[Path] = ()) -> str:
    """Return a command line that can be pasted into a shell in the current folder.

    `modules`: folders for `--modules`. Paths below the current folder are relative.
    """
    own = (word for folder in modules for word in ("--modules", folder))
    return f"{command_name()} {shlex.join(_near(word) for word in (*words, *own))}"


def _near(word: object) -> str:
    here = Path.cwd()
    return str(word.relative_to(here) if isinstance(word, Path) and word.is_relative_to(here) else word)


class OptionError(AcrcError):
    """An invalid option of the command line.

    All have one form: option, value, and what it must be.
    """


@contextmanager
def missing_extra_named() -> Iterator[None]:
    """Name the extra that installs a missing package. Raises AcrcError."""
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
    """Return the file that an option names. Raises OptionError for another suffix or a missing folder."""
    if path.suffix not in suffixes or not path.absolute().parent.is_dir():
        right = f"a file in an existing folder, with the suffix {' or '.join(suffixes)}"
        raise wrong_value(option, path, right)
    return path


def check_choice(option: str, value: str | None, choices: Iterable[str]) -> None:
    """Raise OptionError if the value is not one of the choices; None: the option was not given."""
    if value is not None and value not in choices:
        raise wrong_value(option, value, " or ".join(choices))


def wrong_value(option: str, value: object, right: str) -> OptionError:
    """Return the error that `option` has this value; `right` follows "must be"."""
    text = str(value)
    if len(text) > _LONGEST:
        text = f"{text[:_LONGEST]}…"
    return OptionError(f"{option}: {shlex.quote(text)}; must be {right}")
