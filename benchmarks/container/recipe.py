"""What a Dockerfile and an Apptainer definition say, as far as the project's own use it; all else is refused.

Dockerfile reference: FROM, RUN, COPY, WORKDIR, USER, ENV, ENTRYPOINT. Apptainer user guide, definition files:
the header, %files, %post, %environment, %runscript.
"""

import json
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from actors.runtime.errors import AcrcError

_HEADER: Final = ("Bootstrap", "From")
_SECTIONS: Final = ("files", "post", "environment", "runscript")
_VARIABLE: Final = re.compile(r"([A-Za-z_]\w*)=(.*)")


class RecipeError(AcrcError):
    """A recipe that says something else than is understood here."""


class Shell(NamedTuple):
    """A command of the build."""

    script: str
    """For /bin/sh."""
    user: str
    """A name in the container; root where nothing was said."""
    folder: str
    environment: Mapping[str, str]


class ContextCopy(NamedTuple):
    """A file or folder of the clone that comes into the container."""

    source: str
    """Relative to the clone."""
    target: str
    """Absolute."""
    owner: str
    """USER:GROUP; empty: root's."""


@dataclass(frozen=True)
class ContainerRecipe:
    """How a container is built and what it runs."""

    base: str
    """The image that it begins with."""
    steps: tuple[Shell | ContextCopy, ...]
    entry: tuple[str, ...]
    """What is run, with the caller's words behind it."""
    user: str = ""
    """Who runs it; empty: whoever calls."""
    folder: str = "/"
    environment: Mapping[str, str] = field(default_factory=dict)


def dockerfile(path: Path) -> ContainerRecipe:
    """The recipe of a Dockerfile. Raises RecipeError."""
    base, user, folder, entry = "", "root", "/", tuple[str, ...]()
    environment: dict[str, str] = {}
    steps: list[Shell | ContextCopy] = []
    for number, line in _instructions(path):
        word, _, rest = line.partition(" ")
        match word:
            case "FROM" if not base and len(rest.split()) == 1:
                base = rest
            case "RUN" if base and not rest.startswith(("[", "-", "<")):
                steps.append(Shell(rest, user, folder, dict(environment)))
            case "COPY" if base and rest and (copied := _copy(rest, folder)):
                steps.append(copied)
            case "WORKDIR" if base and rest.startswith("/"):
                folder = rest
                steps.append(Shell(f"mkdir -p {shlex.quote(rest)}", "root", "/", {}))
            case "USER" if base and rest.isidentifier():
                user = rest
            case "ENV" if base and all(_VARIABLE.fullmatch(one) for one in shlex.split(rest)):
                environment |= (one.split("=", 1) for one in shlex.split(rest))  # type: ignore[arg-type]
            case "ENTRYPOINT" if base and rest.startswith("["):
                entry = tuple(json.loads(rest))
            case _:
                raise RecipeError(
                    f"{path}:{number}: {line[:60]}; must be FROM IMAGE, then RUN COMMAND, COPY "
                    "[--chown=USER] SOURCE TARGET, WORKDIR /FOLDER, USER NAME, ENV NAME=VALUE, ENTRYPOINT [...]"
                )
    if not entry:
        raise RecipeError(f"{path}: has no ENTRYPOINT; must have one")
    return ContainerRecipe(base, tuple(steps), entry, user, folder, environment)


def _instructions(path: Path) -> Iterator[tuple[int, str]]:
    """Number of the first line, and the whole instruction on one; comments are left out."""
    begun, first = "", 0
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if re.match(r"#\s*(syntax|escape|check)\s*=", line):
            raise RecipeError(f"{path}:{number}: {line}; must be a comment, no directive of the parser")
        if line.lstrip().startswith("#") or not line.strip():
            continue
        first = first if begun else number
        begun += line.strip()
        if begun.endswith("\\"):
            begun = begun[:-1]
            continue
        yield first, begun
        begun = ""
    if begun:
        yield first, f"{begun}\\"


def _copy(words: str, folder: str) -> ContextCopy | None:
    """None where it is of another form."""
    first, *rest = shlex.split(words)
    owner = first.removeprefix("--chown=") if first.startswith("--chown=") else ""
    named = rest if owner else [first, *rest]
    if len(named) != 2 or named[0].startswith("-"):
        return None
    return ContextCopy(named[0], str(Path(folder, named[1])), owner)


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
        found = _VARIABLE.fullmatch(line.removeprefix("export "))
        if found is None or not line.startswith("export "):
            raise RecipeError(f"{path}: %environment: {line}; must be export NAME=VALUE")
        environment[found[1]] = shlex.split(found[2])[0]
    if not parts["runscript"].strip():
        raise RecipeError(f"{path}: has no %runscript; must have one")
    post = (Shell(f"set -e\n{parts['post']}", "root", "/", {}),)
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
