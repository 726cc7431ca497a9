"""A run in the container has the digest that it has outside: the recipes carried out, and compared."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from actors.console import screen
from actors.installation.repository import clone
from actors.installation.version import software
from actors.runtime.errors import AcrcError
from benchmarks.container.carried import CarriedNetwork, carried
from benchmarks.container.definition import definition
from benchmarks.container.dockerfile import dockerfile, left_out
from benchmarks.container.recipe import ContainerRecipe
from benchmarks.container.tree import PROGRAMS, DebianTree, TreeEntry
from benchmarks.processors.building import NotBuiltError, do, once, provide
from benchmarks.processors.computer import last_words
from benchmarks.statistics.measured import Measured, table_of

_COMMAND: Final = "acrc verify container"
_DOCKERFILE: Final = "Dockerfile"
_SUITE: Final = "bookworm"
_IMAGE: Final = f"debian:{_SUITE}-slim"
"""What `debootstrap --variant=minbase` stands for here."""
_RUN: Final = ("run", "--robots", "2", "--duration", "10")
_STRANGER: Final = "12345"
"""A user whom the container does not know, as Apptainer's callers."""
_FIRST_TIME: Final = ("installing", "compiling")
"""What `acrc` says where something is not ready."""


@dataclass(frozen=True)
class ContainerRow:
    """What came of one recipe."""

    recipe: str
    digest: str = ""
    commit: str = ""
    isolation: str = ""
    ready: bool = False
    """Nothing was installed or compiled before the run."""
    build_s: float = 0.0
    size_mb: int = 0
    fault: str = ""


def recipes() -> Mapping[str, ContainerRecipe]:
    """By its name, each recipe of the project. Raises RecipeError, and AcrcError outside a clone."""
    folder = clone(_COMMAND) / "deploy" / "container"
    return {
        _DOCKERFILE: dockerfile(folder / _DOCKERFILE),
        "acrc.def": definition(folder / "acrc.def"),
    }


def check(build: bool = True, install: bool = False, folder: Path | None = None) -> Measured:
    """Build each recipe in a bare Debian tree, and compare a run inside with the same run outside.

    `build`: False: the recipes are only read. `install`: let apt-get install what is missing. `folder`: where
    the bare tree is kept. Raises AcrcError where nothing can be built.
    """
    wanted = recipes()
    if not build:
        told = [f"{name}: read, {len(one.steps)} steps from {one.base} on" for name, one in wanted.items()]
        return Measured([], [*told, "--full carries them out"])
    try:
        rows, outside = _built(wanted, folder or clone(_COMMAND) / ".container", install)
    except NotBuiltError as error:
        raise AcrcError(f"{_COMMAND}: {error}") from None
    commit = software()
    figures = [asdict(row) for row in rows]
    shown = table_of(figures, f"acrc {' '.join(_RUN)}, inside and without a network")
    said = f"outside: digest {outside}, commit {commit}"
    holds = all((row.digest, row.commit, row.ready) == (outside, commit, True) for row in rows)
    return Measured({"digest": outside, "commit": commit, "rows": figures}, [shown, said], holds)


def _built(
    wanted: Mapping[str, ContainerRecipe], kept: Path, install: bool
) -> tuple[list[ContainerRow], str]:
    """A row for each recipe, and the digest outside."""
    if os.geteuid() != 0:
        raise NotBuiltError("only root can build a tree, and so can sudo")
    provide(PROGRAMS, install=install)
    base = kept / _SUITE
    once(base, lambda place: do("debootstrap", "--variant=minbase", _SUITE, str(place)))
    with tempfile.TemporaryDirectory(prefix="acrc-container-") as name:
        scratch = Path(name)
        scratch.chmod(0o755)
        network = carried(scratch)
        rows = []
        for title, recipe in wanted.items():
            screen(stderr=True).print(f"building {title}, some minutes …")
            try:
                rows.append(_row(title, recipe, base, scratch, network))
            except NotBuiltError as error:
                rows.append(ContainerRow(title, fault=str(error)))
        return rows, _digest_outside(scratch / "outside")


def _row(
    title: str, recipe: ContainerRecipe, base: Path, scratch: Path, network: CarriedNetwork
) -> ContainerRow:
    if recipe.base != _IMAGE:
        raise NotBuiltError(f"begins with {recipe.base}; must be {_IMAGE}")
    tree, began = DebianTree(scratch / "tree"), time.monotonic()
    tree.build(base, _context(scratch / "context", title), recipe, network)
    took_s = round(time.monotonic() - began, 1)
    size_mb = int(subprocess.check_output(["du", "-sm", str(tree.root)], text=True).split()[0])
    shared = scratch / f"tmp-{title}"
    shared.mkdir()
    shared.chmod(0o1777)
    way = TreeEntry(
        recipe.user or _STRANGER, recipe.folder, recipe.environment, {Path("/tmp"): shared},
        alone=True, sealed=not recipe.user,
    )  # fmt: skip
    done = tree.enter(way, (*recipe.entry, *_RUN, "--out", "/tmp/out"))
    if done.returncode:
        raise NotBuiltError(f"acrc {' '.join(_RUN)} {last_words(done.stderr)}")
    result = json.loads((shared / "out" / "run.json").read_text())
    ready = not any(word in done.stderr for word in _FIRST_TIME)
    return ContainerRow(
        title, result["digest"], result["origin"]["commit"], result["isolation"], ready, took_s, size_mb
    )


def _context(folder: Path, title: str) -> Path:
    """A clone as a builder finds it; a worktree has no .git of its own."""
    shutil.rmtree(folder, ignore_errors=True)
    do("git", "clone", "--quiet", "--no-checkout", str(clone(_COMMAND)), str(folder))
    if title == _DOCKERFILE:
        for name in left_out(clone(_COMMAND) / ".dockerignore"):
            do("rm", "-rf", str(folder / name))
    return folder


def _digest_outside(out: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-P", "-m", "command_line", *_RUN, "--out", str(out)],
        cwd=clone(_COMMAND), capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise NotBuiltError(f"outside: acrc {' '.join(_RUN)} {last_words(done.stderr)}")
    return str(json.loads((out / "run.json").read_text())["digest"])
