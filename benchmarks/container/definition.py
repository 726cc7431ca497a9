"""An Apptainer definition, as far as the project's own goes; all else is refused.

After the Apptainer user guide: the header, %files, %post, %environment, %runscript.
"""

import shlex
from pathlib import Path
from typing import Final

from benchmarks.container.dockerfile import VARIABLE
from benchmarks.container.recipe import BuildCommand, ContainerRecipe, ContextCopy, RecipeError

_HEADER: Final = ("Bootstrap", "From")
_SECTIONS: Final = ("files", "post", "environment", "runscript")


def definition(path: Path) -> ContainerRecipe:
    """The recipe of an Apptainer definition. Raises RecipeError."""
    header, parts = _parts(path)
    if header.get("Bootstrap") != "docker" or set(header) != set(_HEADER):
        raise RecipeError(f"{path}: its header is {header}; must be Bootstrap: docker and From: IMAGE")
    copies = []
    for line in filter(None, map(str.strip, parts["files"].splitlines())):
        source, target = (*shlex.split(line), "", "")[:2]
        if len(shlex.split(line)) != 2 or not target.startswith("/"):
            raise RecipeError(f"{path}: %files: {line}; must be SOURCE /TARGET")
        copies.append(ContextCopy(source, target, ""))
    environment = {}
    for line in filter(None, map(str.strip, parts["environment"].splitlines())):
        found = VARIABLE.fullmatch(line.removeprefix("export "))
        if found is None or not line.startswith("export "):
            raise RecipeError(f"{path}: %environment: {line}; must be export NAME=VALUE")
        environment[found[1]] = shlex.split(found[2])[0]
    if not parts["runscript"].strip():
        raise RecipeError(f"{path}: has no %runscript; must have one")
    post = (BuildCommand(f"set -e\n{parts['post']}", "root", "/", {}),)
    entry = ("/bin/sh", "-c", parts["runscript"], "runscript")
    return ContainerRecipe(header["From"], (*copies, *post), entry, environment=environment)


def _parts(path: Path) -> tuple[dict[str, str], dict[str, str]]:
    """The header's keys, and the text of each section."""
    header: dict[str, str] = {}
    parts = dict.fromkeys(_SECTIONS, "")
    section = ""
    for number, line in enumerate(path.read_text().splitlines(), 1):
        key, _, value = (part.strip() for part in line.partition(":"))
        if line.startswith("%"):
            section = line[1:].strip()
            if section not in _SECTIONS:
                known = ", ".join(f"%{name}" for name in _SECTIONS)
                raise RecipeError(f"{path}:{number}: {line}; must be one of {known}")
        elif not line.strip() or line.lstrip().startswith("#"):
            continue
        elif section:
            parts[section] += f"{line}\n"
        elif key in _HEADER and value:
            header[key] = value
        else:
            raise RecipeError(f"{path}:{number}: {line}; must be Bootstrap: docker or From: IMAGE")
    return header, parts
