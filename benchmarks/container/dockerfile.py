"""A Dockerfile and a .dockerignore, as far as the project's own go; all else is refused.

After the Dockerfile reference: FROM, RUN, COPY, WORKDIR, USER, ENV, ENTRYPOINT.
"""

import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from benchmarks.container.recipe import BuildCommand, ContainerRecipe, ContextCopy, RecipeError

VARIABLE: Final = re.compile(r"([A-Za-z_]\w*)=(.*)")


def dockerfile(path: Path) -> ContainerRecipe:
    """The recipe of a Dockerfile. Raises RecipeError."""
    base, user, folder, entry = "", "root", "/", tuple[str, ...]()
    environment: dict[str, str] = {}
    steps: list[BuildCommand | ContextCopy] = []
    for number, line in _instructions(path):
        word, _, rest = line.partition(" ")
        match word:
            case "FROM" if not base and len(rest.split()) == 1:
                base = rest
            case "RUN" if base and not rest.startswith(("[", "-", "<")):
                steps.append(BuildCommand(rest, user, folder, dict(environment)))
            case "COPY" if base and rest and (copied := _copy(rest, folder)):
                steps.append(copied)
            case "WORKDIR" if base and rest.startswith("/"):
                folder = rest
                steps.append(BuildCommand(f"mkdir -p {shlex.quote(rest)}", "root", "/", {}))
            case "USER" if base and rest.isidentifier():
                user = rest
            case "ENV" if base and all(map(VARIABLE.fullmatch, shlex.split(rest))):
                environment |= {one.partition("=")[0]: one.partition("=")[2] for one in shlex.split(rest)}
            case "ENTRYPOINT" if base and rest.startswith("["):
                entry = tuple(json.loads(rest))
            case _:
                raise RecipeError(
                    f"{path}:{number}: {line[:60]}; must be FROM IMAGE, then RUN COMMAND, COPY "
                    "[--chown=USER] SOURCE TARGET, WORKDIR /FOLDER, USER NAME, ENV NAME=VALUE or "
                    "ENTRYPOINT [...]"
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
        raise RecipeError(f"{path}:{first}: {begun[:60]} ends with a backslash; must go on below it")


def _copy(words: str, folder: str) -> ContextCopy | None:
    """None where it is of another form."""
    first, *rest = shlex.split(words)
    owner = first.removeprefix("--chown=") if first.startswith("--chown=") else ""
    named = rest if owner else [first, *rest]
    if len(named) != 2 or named[0].startswith("-"):
        return None
    return ContextCopy(named[0], str(Path(folder, named[1])), owner)


def left_out(path: Path) -> list[str]:
    """What a .dockerignore keeps back of the one folder that it lets in. Raises RecipeError."""
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    if lines[:2] != ["*", "!.git"] or not all(re.fullmatch(r"\.git/[\w/-]+", line) for line in lines[2:]):
        raise RecipeError(f"{path}: {lines}; must be *, then !.git, then names below .git/")
    return lines[2:]
