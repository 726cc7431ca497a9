"""A bare Debian system in a folder, as on a robot's computer, entered as a system of its own.

Whoever enters it needs root's rights. An ARM system's programs run in an emulator of processes, of which
Linux is told for as long as somebody is inside.
"""

import platform
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.processors.building import do
from deploy.fleet.bundle.wheels import MACHINES

_ARCHITECTURES: Final = {"x86-64": "amd64", "aarch64": "arm64"}
"""As Debian names them."""
EMULATOR: Final = "qemu-aarch64-static"
_ARM_PROGRAM: Final = r"\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00"
_MASK: Final = r"\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff"
_ENTER: Final = f"""
set -e
root=$1 shared=$2 emulator=$3; shift 3
if [ -n "$emulator" ]; then
    known=/proc/sys/fs/binfmt_misc
    [ -e $known/register ] || mount -t binfmt_misc none $known
    [ -e $known/qemu-aarch64 ] || [ -e $known/acrc-aarch64 ] ||
        printf '%s' ':acrc-aarch64:M::{_ARM_PROGRAM}:{_MASK}:'"$emulator:F" >$known/register
fi
mount --bind "$root" "$root"
mount --rbind /dev "$root/dev"
mount -t proc proc "$root/proc"
mkdir -p "$root$shared"
mount --bind "$shared" "$root$shared"
cd "$root"
mount --move . /
exec chroot . /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C HOME=/root "$@"
"""
"""The system takes the root's place, as when a computer starts: in a mere chroot no robot has a sandbox."""


def is_emulated(machine: str) -> bool:
    """True if this computer cannot run that one's programs, one of MACHINES."""
    return MACHINES[machine] != platform.machine()


def system(place: Path, machine: str) -> None:
    """Build Debian 12 for `machine` in the folder `place`, with Python. Raises NotBuiltError."""
    words = (f"--arch={_ARCHITECTURES[machine]}", "--variant=minbase", "--include=python3,python3-venv")
    foreign = ("--foreign",) if is_emulated(machine) else ()
    do("debootstrap", *words, *foreign, "bookworm", str(place))
    if foreign:
        second = ("/debootstrap/debootstrap", "--second-stage")
        do(*inside(place, place.parent, machine, second, network=True))


def copied(place: Path, to: Path) -> None:
    """A copy of a system, in which somebody may do what he likes. Raises NotBuiltError."""
    do("cp", "-a", "--reflink=auto", str(place), str(to))


def inside(
    root: Path, shared: Path, machine: str, words: Sequence[str], *, network: bool = False
) -> tuple[str, ...]:
    """The command that runs `words` in the system; it ends, and all in it, as soon as the command is killed.

    `shared`: a folder that both see by the same path. Without `network` there is none inside.
    """
    emulator = (shutil.which(EMULATOR) or "") if is_emulated(machine) else ""
    own = ("--mount", "--pid", "--fork", "--kill-child", *(() if network else ("--net",)))
    return ("unshare", *own, "sh", "-c", _ENTER, "sh", str(root), str(shared), emulator, *words)
