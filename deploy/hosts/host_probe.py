"""What a computer has to offer to a run: `python -m deploy.hosts.host_probe` prints it as JSON."""

import os
import socket
import sys
from typing import Annotated

import msgspec

from acrc_testbed.results.result import versions
from actors.installation.repository import REPOSITORY
from actors.installation.version import software
from actors.processes.kernels import compile_kernels
from actors.robot import assembly
from actors.runtime.errors import printable
from actors.runtime.isolation import sandbox
from actors.runtime.processor import few, otherwise
from deploy.hosts.channel import Words


class HostOffer(msgspec.Struct, frozen=True):
    """A computer, as it describes itself."""

    name: Words
    """Its host name."""
    cores: Annotated[int, msgspec.Meta(ge=1, le=100_000)]
    """That the worker may use."""
    commit: Words
    versions: dict[str, str]
    """Of Python and the packages whose versions matter."""
    kernels: dict[str, str]
    """Their fingerprints."""
    isolation_fault: Words | None
    """Why robots cannot be isolated there; None if they can."""
    repository: Words
    """Where this software lies there."""


def offer() -> HostOffer:
    """Of this computer; kernels are compiled first if they are not."""
    compile_kernels(quiet=True)
    return HostOffer(
        name=socket.gethostname(),
        cores=len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1,
        commit=software(),
        versions=versions(),
        kernels=assembly.kernels(),
        isolation_fault=sandbox.available(),
        repository=str(REPOSITORY),
    )


def unfit(there: HostOffer, here: HostOffer) -> str | None:
    """Why a computer cannot have a part in a run that is started here, to go on after its name; None."""
    if there.commit != here.commit:
        return printable(
            f"has {there.commit}, this is {here.commit}; must be the same: git -C {there.repository} "
            f"fetch && git -C {there.repository} checkout {here.commit.removesuffix('+')}, and start its "
            "worker anew"
        )
    for name, version in here.versions.items():
        if (other := there.versions.get(name)) != version:
            return printable(f"has {name} {other}, this is {version}; must be the same")
    if names := otherwise(there.kernels, here.kernels):
        return printable(f"computes otherwise than this computer: other bits come from {few(names)}")
    return None


def main() -> int:
    """Print the offer; the exit code."""
    sys.stdout.write(msgspec.json.encode(offer()).decode() + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
