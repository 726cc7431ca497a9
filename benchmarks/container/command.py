"""The container's recipes, read and carried out: a run in what they build has the digest that it has outside."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from actors.console import screen
from actors.installation.repository import clone
from actors.installation.version import software
from actors.runtime.errors import AcrcError
from benchmarks.container.carried import carried
from benchmarks.container.recipe import ContainerRecipe, definition, dockerfile
from benchmarks.container.tree import PROGRAMS, DebianTree, Way
from benchmarks.processors.building import NotBuiltError, do, once, provide
from benchmarks.processors.computer import last_words
from benchmarks.statistics.measured import Measured, table_of

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
    digest: str
    commit: str = ""
    isolation: str = ""
    ready: bool = False
    """Nothing was installed or compiled before the run."""
    build_s: float = 0.0
    size_mb: int = 0
    fault: str = ""


def recipes() -> Mapping[str, ContainerRecipe]:
    """By its name, each recipe of the project. Raises RecipeError, and AcrcError outside a clone."""
    folder = clone("acrc verify container") / "deploy" / "container"
    return {
        "Dockerfile": dockerfile(folder / "Dockerfile"),
        "acrc.def": definition(folder / "acrc.def"),
    }


def check(build: bool = True, install: bool = False, folder: Path | None = None) -> Measured:
    """Build each recipe in a bare Debian tree, and compare a run inside with the same run outside.

    `build`: False: the recipes are only read. `install`: let apt-get install what is missing. `folder`: for
    the bare tree, which is kept. Raises AcrcError where nothing can be built.
    """
    wanted = recipes()
    if not build:
        told = [
            f"{name}: begins with {recipe.base}, {len(recipe.steps)} steps" for name, recipe in wanted.items()
        ]
        return Measured([], [*told, "They were read, not carried out: --full does."])
    kept = folder or clone("acrc verify container") / ".container"
    try:
        rows, outside = _built(wanted, kept, install)
    except NotBuiltError as error:
        raise AcrcError(f"verify container: {error}") from None
    holds = all(one.digest == outside["digest"] and one.commit == software() and one.ready for one in rows)
    shown = table_of([asdict(row) for row in rows], "acrc run --robots 2 --duration 10, without a network")
    return Measured(
        {"outside": outside, "rows": [asdict(row) for row in rows]},
        [shown, f"outside: {outside['digest']}, commit {software()}"],
        holds,
    )


def _built(
    wanted: Mapping[str, ContainerRecipe], kept: Path, install: bool
) -> tuple[list[ContainerRow], dict[str, Any]]:
    """A row for each recipe, and the result of the run outside."""
    if os.geteuid() != 0:
        raise NotBuiltError("a tree is built by root only; run it as root, such as by sudo")
    provide(PROGRAMS, install)
    base = kept / _SUITE
    once(base, lambda place: do("debootstrap", "--variant=minbase", _SUITE, str(place)))
    with tempfile.TemporaryDirectory(prefix="acrc-container-") as name:
        scratch = Path(name)
        context, network = scratch / "context", carried(scratch)
        do("git", "clone", "--quiet", "--no-checkout", str(clone("acrc verify container")), str(context))
        rows = []
        for title, recipe in wanted.items():
            screen(stderr=True).print(f"building {title}, some minutes …")
            tree = DebianTree(scratch / "tree")
            began = time.monotonic()
            try:
                if recipe.base != _IMAGE:
                    raise NotBuiltError(f"begins with {recipe.base}; must be {_IMAGE}")
                tree.build(base, context, recipe, network)
                rows.append(_row(title, recipe, tree, scratch, round(time.monotonic() - began, 1)))
            except NotBuiltError as error:
                rows.append(ContainerRow(title, "", fault=str(error)))
        return rows, _outside(scratch / "outside")


def _row(title: str, recipe: ContainerRecipe, tree: DebianTree, scratch: Path, took_s: float) -> ContainerRow:
    size = int(subprocess.check_output(["du", "-sm", str(tree.root)], text=True).split()[0])
    place = scratch / title
    place.mkdir()
    place.chmod(0o1777)
    way = Way(
        recipe.user or _STRANGER, recipe.folder, recipe.environment, {Path("/tmp"): place}, True,
        sealed=not recipe.user,
    )  # fmt: skip
    done = tree.enter(way, (*recipe.entry, *_RUN, "--out", "/tmp/out"))
    if done.returncode:
        raise NotBuiltError(f"acrc {' '.join(_RUN)} {last_words(done.stderr)}")
    result = json.loads((place / "out" / "run.json").read_text())
    ready = not any(word in done.stderr for word in _FIRST_TIME)
    return ContainerRow(
        title, result["digest"], result["commit"], result["isolation"], ready, took_s, size
    )  # fmt: skip


def _outside(out: Path) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-P", "-m", "command_line", *_RUN, "--out", str(out)],
        cwd=clone("acrc verify container"), capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise NotBuiltError(f"outside: acrc {' '.join(_RUN)} {last_words(done.stderr)}")
    result: dict[str, Any] = json.loads((out / "run.json").read_text())
    with suppress(KeyError):
        return {"digest": result["digest"], "isolation": result["isolation"]}
    raise NotBuiltError("outside: run.json has no digest")
