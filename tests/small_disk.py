"""A disk that is soon full: a file system of its own, which only the command on it and its children see."""

from collections.abc import Sequence
from pathlib import Path

_MOUNT = 'size=$1 folder=$2; shift 2; mount -t tmpfs -o size="$size" none "$folder" && exec "$@"'


def on_small_disk(folder: Path, size: str, words: Sequence[str]) -> list[str]:
    """The command that runs `words` with `folder`, made if need be, on a disk of `size`, such as `64k`."""
    folder.mkdir(exist_ok=True)
    return ["unshare", "--map-root-user", "--mount", "sh", "-c", _MOUNT, "sh", size, str(folder), *words]
