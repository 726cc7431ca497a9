"""How this machine reaches Debian and Python packages, carried into a tree that knows nothing of it."""

import ast
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.processors.building import do

_PIP: Final = (
    *("index-url", "extra-index-url", "no-index", "find-links", "cert", "constraint", "trusted-host"),
    *("proxy", "default-timeout", "retries"),
)
"""Settings of pip that say from where it takes packages."""
_APT: Final = re.compile(r"Acquire::(https?::|Check-|Retries).*")
_PROXIES: Final = ("http_proxy", "https_proxy", "no_proxy")
_PLACE: Final = Path("/run/carried")
"""Where the tree sees what the settings name."""


@dataclass(frozen=True)
class CarriedNetwork:
    """What a tree gets while it is built, and does not keep."""

    environment: dict[str, str] = field(default_factory=dict)
    files: dict[Path, Path] = field(default_factory=dict)
    """By the place in the tree, what is seen there of this machine."""


def carried(scratch: Path) -> CarriedNetwork:
    """The settings of this machine's pip and apt, and its resolver. `scratch`: a folder for what is made."""
    found = CarriedNetwork({name: os.environ[name] for name in _PROXIES if name in os.environ})
    for name in ("hosts", "resolv.conf"):
        found.files[Path("/etc", name)] = Path("/etc", name)
    settings = scratch / "apt.conf"
    dumped = subprocess.run(["apt-config", "dump"], capture_output=True, text=True, check=True).stdout
    settings.write_text("".join(f"{line}\n" for line in dumped.splitlines() if _APT.fullmatch(line)))
    found.files[Path("/etc/apt/apt.conf.d/99carried")] = settings
    do(sys.executable, "-m", "venv", "--clear", str(scratch / "pip"))
    asked = [str(scratch / "pip" / "bin" / "python"), "-m", "pip", "config", "list"]
    listed = subprocess.run(asked, capture_output=True, text=True, check=True).stdout
    for name, value in pip_settings(listed).items():
        found.environment[f"PIP_{name.upper().replace('-', '_')}"] = _moved(value, found.files)
    return found


def pip_settings(listed: str) -> Mapping[str, str]:
    """By name, of what `pip config list` says, what concerns the way to packages; variables come last."""
    lines = sorted(listed.splitlines(), key=lambda line: line.startswith(":env:"))
    pairs = [line.partition("=")[::2] for line in lines]
    named = {key.rpartition(".")[2]: str(ast.literal_eval(value)) for key, value in pairs if value}
    return {name: value for name, value in named.items() if name in _PIP}


def _moved(value: str, files: dict[Path, Path]) -> str:
    """The value as it is meant in the tree; what it names of this machine is added to `files`."""
    words = []
    for word in value.split():
        path = Path(word.removeprefix("file://"))
        if path.is_absolute() and path.exists():
            # The pages of an index lead to files beside them.
            shown = path.parent if word.startswith("file://") else path
            place = _PLACE / str(len(files))
            files[place] = shown
            seen = place / path.relative_to(shown)
            words.append(f"file://{seen}" if word.startswith("file://") else str(seen))
        else:
            words.append(word)
    return "\n".join(words)
