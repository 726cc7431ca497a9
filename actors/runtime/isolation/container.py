"""Which container this process is in, and what of it lets robots be isolated.

A container's own filter on system calls comes first: Docker's refuses the namespaces, and with `--cap-add
SYS_ADMIN` still pivot_root(2). docs/trust.md has a table.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

_DOCKER: Final = (
    "start it with --security-opt seccomp=deploy/container/seccomp.json, where AppArmor is on also with "
    "--security-opt apparmor=unconfined"
)
_REMEDIES: Final = {
    "Apptainer": "allow unprivileged user namespaces on the machine that it runs on",
    "Kubernetes": "give it securityContext.seccompProfile.type: Unconfined, where AppArmor is on also "
    "appArmorProfile.type: Unconfined",
    "Podman": _DOCKER,
    "Docker": _DOCKER,
}
_OTHERWISE: Final = "let it make user namespaces and mounts"
_VARIABLES: Final = {
    "APPTAINER_CONTAINER": "Apptainer",
    "SINGULARITY_CONTAINER": "Apptainer",
    "KUBERNETES_SERVICE_HOST": "Kubernetes",
}
_FILES: Final = {".singularity.d": "Apptainer", "run/.containerenv": "Podman", ".dockerenv": "Docker"}
_NAMED_IN: Final = "container"
"""Variable with the container's kind, as systemd's Container Interface has it."""
_OWN_WORDS: Final = {"docker": "Docker", "podman": "Podman", "kubernetes": "Kubernetes"}
_ON_THE_MACHINE: Final = "allow unprivileged user namespaces on this machine"


def kind(environment: Mapping[str, str] = os.environ, root: Path = Path("/")) -> str:
    """What sort of container this is; empty: none that is known."""
    for name, sort in _VARIABLES.items():
        if environment.get(name):
            return sort
    for name, sort in _FILES.items():
        if (root / name).exists():
            return sort
    named = environment.get(_NAMED_IN, "")
    return _OWN_WORDS.get(named, named)


def marks(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """The variables that tell it, for a process that is told nothing else."""
    return {name: environment[name] for name in (*_VARIABLES, _NAMED_IN) if name in environment}


def remedy() -> str:
    """What lets robots be isolated here."""
    sort = kind()
    return f"this is a container ({sort}): {_REMEDIES.get(sort, _OTHERWISE)}" if sort else _ON_THE_MACHINE


def advice() -> str:
    """The same, or the way round; how each IsolationError's sentence ends."""
    return f"{remedy()}, or run with --no-isolate"
