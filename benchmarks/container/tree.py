"""A bare Debian tree in which a recipe is carried out, and then what it has built is run."""

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.container.carried import CarriedNetwork
from benchmarks.container.recipe import BuildCommand, ContainerRecipe, ContextCopy
from benchmarks.processors.building import NotBuiltError, do
from benchmarks.processors.computer import last_words

PROGRAMS: Final = {"debootstrap": "debootstrap", "unshare": "util-linux", "git": "git"}
"""What is needed, and the Debian packages that bring it."""
_PATIENCE_S: Final = 3600.0
_ENTER: Final = """
root=$1 user=$2 folder=$3 sealed=$4
shift 4
mount --bind "$root" "$root"
cd "$root"
mount -t proc proc proc
mount --rbind /sys sys
mount --rbind /dev dev
while [ "$1" != -- ]; do
    if [ -d "$1" ]; then mkdir -p "./$2"; else mkdir -p "./${2%/*}" && : >>"./$2"; fi
    mount --bind "$1" "./$2"
    shift 2
done
shift
mkdir .before
pivot_root . .before
umount -l /.before
rmdir /.before
[ -z "$sealed" ] || mount -o remount,bind,ro /
home=$(getent passwd "$user" | cut -d: -f6)
group=$(id -g "$user" 2>/dev/null || echo "$user")
cd "$folder"
exec setpriv --reuid "$user" --regid "$group" --clear-groups env -i "HOME=${home:-/tmp}" \
    PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"
"""
"""Change the root, not only what / means to one process: in a chroot there are no new user namespaces."""


@dataclass(frozen=True)
class TreeEntry:
    """How a tree is entered."""

    user: str
    """By name or number."""
    folder: str
    environment: Mapping[str, str]
    shown: Mapping[Path, Path]
    """By the place inside, what is seen there of this machine."""
    alone: bool = False
    """Without a network."""
    sealed: bool = False
    """Nothing but what is shown can be written to, as in Apptainer."""


@dataclass(frozen=True)
class DebianTree:
    """A file tree that is entered as the root of all files, with processes of its own."""

    root: Path

    def build(self, base: Path, context: Path, recipe: ContainerRecipe, network: CarriedNetwork) -> None:
        """Carry out the recipe in a copy of the bare tree `base`. Raises NotBuiltError.

        `context`: the folder that it copies from. `network`: what is seen of this machine meanwhile.
        """
        shutil.rmtree(self.root, ignore_errors=True)
        do("cp", "-a", str(base), str(self.root))
        for step in recipe.steps:
            shell = self._copied(context, step) if isinstance(step, ContextCopy) else step
            variables = {**shell.environment, **network.environment}
            way = TreeEntry(shell.user, shell.folder, variables, network.files)
            done = self.enter(way, ("/bin/sh", "-c", shell.script))
            if done.returncode:
                raise NotBuiltError(f"{shell.script.strip()[:60]} … {last_words(done.stderr)}")

    def _copied(self, context: Path, step: ContextCopy) -> BuildCommand:
        """Copy it; what is still to be done inside, where the owner's name is known."""
        target = self.root / step.target.lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        do("cp", "-a", str(context / step.source), str(target))
        return BuildCommand(f"chown -R {step.owner or 'root:root'} {step.target}", "root", "/", {})

    def enter(self, way: TreeEntry, command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
        """What a command says inside."""
        own = ["--net"] if way.alone else []
        pairs = [str(path) for place, source in way.shown.items() for path in (source, place)]
        inside = [str(self.root), way.user, way.folder, "sealed" if way.sealed else "", *pairs, "--"]
        variables = [f"{name}={value}" for name, value in way.environment.items()]
        try:
            return subprocess.run(
                ["unshare", "--mount", "--pid", "--fork", "--kill-child", *own, "--",
                 "/bin/sh", "-euc", _ENTER, "sh", *inside, *variables, *command],
                capture_output=True, text=True, check=False, timeout=_PATIENCE_S, stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise NotBuiltError(f"{' '.join(command)[:60]} … took longer than {_PATIENCE_S:g} s") from None
