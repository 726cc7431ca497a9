"""The archive of a bundle: the same files give the same bytes, and only its owner may read it."""

import hashlib
import io
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from actors.runtime import regular_file
from observation.results.seal import SUMS, lines

_WHEN: Final = 946_684_800
"""2000-01-01: a later installation makes a ZIP file of what it unpacks, which knows no time before 1980."""
PRIVATE: Final = 0o600


class BundledFile(NamedTuple):
    """A file of the bundle."""

    content: bytes
    mode: int = 0o644


def write(path: Path, top: str, files: Mapping[str, BundledFile], links: Mapping[str, str]) -> None:
    """Write files and links into the folder `top` of a new tar archive, with the SHA-256 of all files.

    `links`: where each leads, by its name. The archive is there whole or not at all. May raise OSError.
    """
    sums = {name: hashlib.sha256(file.content).hexdigest() for name, file in files.items()}
    whole = {**files, SUMS: BundledFile(lines(sums))}
    with regular_file.replaced(path) as new:
        new.chmod(PRIVATE)
        with tarfile.open(new, "w", format=tarfile.GNU_FORMAT) as archive:
            for name in sorted({*whole, *links}):
                entry = tarfile.TarInfo(f"{top}/{name}")
                entry.mtime = _WHEN
                if name in links:
                    entry.type, entry.linkname, entry.mode = tarfile.SYMTYPE, links[name], 0o777
                    archive.addfile(entry)
                else:
                    entry.size, entry.mode = len(whole[name].content), whole[name].mode
                    archive.addfile(entry, io.BytesIO(whole[name].content))
