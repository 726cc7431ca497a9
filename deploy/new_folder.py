"""A new folder for what a run writes, that no other run takes in the same instant."""

from itertools import count
from pathlib import Path

from deploy.usage import OptionError


def claim(parent: Path, name: str) -> Path:
    """Make a folder `name` in `parent`, or `name-2` and so on where that exists; its absolute path.

    To make it is to claim it. Raises OptionError where none can be made.
    """
    for number in count(1):
        folder = parent.absolute() / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if folder.parent.is_dir():
                continue
            raise OptionError(f"{folder.parent}: is a file; must be a folder, for the results") from None
        except OSError as error:
            raise OptionError(
                f"{folder}: cannot be made ({reason(error)}); choose another place by --out"
            ) from None
        return folder
    raise AssertionError("count has no end")


def reason(error: OSError) -> str:
    """What the system says, and of which file if it is another than one asked for."""
    return (error.strerror or str(error)).lower()
