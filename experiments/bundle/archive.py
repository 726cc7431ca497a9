"""A ZIP file that has the same bytes whenever and wherever it is made of the same content."""

import hashlib
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from actors.runtime import regular_file
from observation.results.seal import SUMS, lines

_BEGIN: Final = (1980, 1, 1, 0, 0, 0)
"""The earliest instant that the format knows."""
_UNIX: Final = 3


def write(path: Path, top: str, files: Mapping[str, bytes]) -> None:
    """Write the files into folder `top` of a new archive, with the SHA-256 sums of all in SUMS.

    What ends in `.sh` can be executed. The file is there whole or not at all.
    """
    sums = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    whole = {**files, SUMS: lines(sums)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with regular_file.replaced(path) as new, zipfile.ZipFile(new, "w") as archive:
        for name in sorted(whole):
            info = zipfile.ZipInfo(f"{top}/{name}", _BEGIN)
            info.create_system = _UNIX
            info.external_attr = (0o100755 if name.endswith(".sh") else 0o100644) << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, whole[name], compresslevel=9)
